"""View-dependent opacities of Gaussians of an absorbing medium, by a C++ kernel and a reference implementation.

A ray through the centre of a Gaussian of density rho crosses an optical depth of sqrt(2 pi) rho sigma(d). Here sigma(d)
= 1 / |S^-1 R^T d| is the standard deviation along the ray's direction d. This is absorption (Max 1995, equation 1) over
the line integral of a Gaussian (Zwicker et al. 2002, "EWA Splatting", section 3.2). The same density is opaque along a
needle and faint from its side: one opacity for all directions would suit spheres only.
"""

from __future__ import annotations

import torch
from torch import Tensor

from native import kernels
from native.threads import cores
from surrogate.splatting.kernel_function import KernelFunction, kernel_takes
from surrogate.splatting.reference import rotations
from surrogate.splatting.rendering import Constants

MOST_DEPTH = 80.0  # exp(-80) is zero to every digit


def opacities_along_rays(
    means: Tensor,
    log_scales: Tensor,
    quats: Tensor,
    opacity_logits: Tensor,
    position: Tensor,
    *,
    threads: int | None = None,
) -> Tensor:
    """Opacities (N,) at the centres of N Gaussians as seen from `position` (3,); differentiable by the four tensors.

    An isotropic Gaussian has the sigmoid of its logit from everywhere. Others have the optical depth of a ball of the
    same volume times sigma(d) over its radius: 1 - exp(-softplus(logit) sigma(d) / (s_1 s_2 s_3)^(1/3)). At the centre
    itself there is no direction, and the Gaussian counts as a ball. The kernel computes on a CPU in float32; otherwise,
    and where a gradient by `position` is needed, `opacities_along_rays_reference` does.

    Parameters
    ----------
    means : (N, 3).
    log_scales : (N, 3), logarithms of the standard deviations along the principal axes.
    quats : (N, 4), rotations as w, x, y, z, of any length.
    opacity_logits : (N,).
    """
    tensors = (means, log_scales, quats, opacity_logits)
    if not kernel_takes(position, *tensors):
        return opacities_along_rays_reference(*tensors, position)
    place = tuple(position.tolist()), Constants.shortest_quaternion
    count = cores() if threads is None else threads
    kernel = KernelFunction(
        "opacities_along_rays",
        "opacities_along_rays_reference",
        lambda *arrays: kernels.ray_opacities(arrays, *place, count),
        lambda by, *arrays: kernels.ray_opacities_gradient(arrays, *place, by, count),
    )
    return kernel(*tensors)


def opacities_along_rays_reference(
    means: Tensor, log_scales: Tensor, quats: Tensor, opacity_logits: Tensor, position: Tensor
) -> Tensor:
    """The reference implementation in plain torch, on any device and in any float dtype."""
    rays = means - position  # [N, 3]
    directions = rays / torch.where(
        (rays == 0.0).all(dim=1, keepdim=True), 1.0, rays.norm(dim=1, keepdim=True)
    )  # [N, 3]
    local = torch.einsum("nck,nc->nk", rotations(quats), directions)  # [N, 3]
    stretches = log_scales - log_scales.mean(
        dim=1, keepdim=True
    )  # [N, 3], logarithms of scales over their geometric mean
    squared = (local * torch.exp(-stretches)).square().sum(dim=1)  # [N]
    ratios = torch.where(squared == 0.0, 1.0, squared).rsqrt()  # [N]
    depths = (torch.nn.functional.softplus(opacity_logits) * ratios).clamp(max=MOST_DEPTH)  # [N]
    return -torch.expm1(-depths)
