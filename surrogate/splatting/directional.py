"""View-dependent colours of Gaussians in spherical harmonics of degree 1, by a C++ kernel and a reference implementation.

Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering", section 2.1: colours in real spherical harmonics,
here of degrees 0 and 1.
"""

from __future__ import annotations

import torch
from torch import Tensor

from native import kernels
from native.threads import cores
from surrogate.splatting.kernel_function import KernelFunction, kernel_takes

SH_C1 = 0.4886025119029199  # sqrt(3 / (4 pi)), the factor of the real spherical harmonics of degree 1


def directional_colors(means: Tensor, colors: Tensor, position: Tensor, *, threads: int | None = None) -> Tensor:
    """Colours (N, 3), not clamped, of N Gaussians as seen from `position` (3,); differentiable by means and coefficients.

    At the mean itself there is no direction, and the constant coefficient is the colour. The kernel computes on a CPU
    in float32; otherwise, and where a gradient by `position` is needed, `directional_colors_reference` does.

    Parameters
    ----------
    means : (N, 3).
    colors : (N, 12), coefficients of 3 channels each: the constant one, and those of degree 1, by y, z, x.
    """
    if not kernel_takes(position, means, colors):
        return directional_colors_reference(means, colors, position)
    place, count = position.tolist(), cores() if threads is None else threads
    kernel = KernelFunction(
        "directional_colors",
        "directional_colors_reference",
        lambda means, colors: kernels.directional_colors(means, colors, place, count),
        lambda by, means, colors: kernels.directional_colors_gradient(means, colors, place, by, count),
    )
    return kernel(means, colors)


def directional_colors_reference(means: Tensor, colors: Tensor, position: Tensor) -> Tensor:
    """The reference implementation in plain torch, on any device and in any float dtype."""
    x, y, z = (SH_C1 * directions(means, position)).split(1, dim=1)  # [N, 1] each
    constant, by_y, by_z, by_x = colors.split(3, dim=1)  # [N, 3] each
    return constant - y * by_y + z * by_z - x * by_x


def directions(means: Tensor, position: Tensor) -> Tensor:
    """Unit vectors (N, 3) from `position` (3,) to `means` (N, 3), zero at `position` itself, in plain torch."""
    rays = means - position  # [N, 3]
    nowhere = (rays == 0.0).all(dim=1, keepdim=True)  # [N, 1]
    lengths = torch.where(nowhere, 1.0, rays.norm(dim=1, keepdim=True))  # [N, 1]
    return torch.where(nowhere, 0.0, rays / lengths)
