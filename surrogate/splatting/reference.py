"""The reference implementation of splatting in plain torch: slow, readable, differentiable, at any precision.

Gaussians are projected by EWA splatting (Zwicker, Pfister, van Baar & Gross 2002; Kerbl et al. 2023, section 4) and
composited front to back in the order of their centres' depth:

    alpha_i(p) = min(cap, opacity_i exp(-1/2 d^T S_i^-1 d)),   d = p - centre_i,
    color(p)   = sum_i T_i alpha_i color_i,    T_i = prod_{j<i} (1 - alpha_j).

Contributions with alpha below the floor are left out, and so is what follows once T_i < 1e-4.  Depths are compared in
float32, equal ones by index.  Every other backend is tested against this one, forward and backward.

With M (2 x 3) the projected principal axes, S = M M^T + dilation I.  By the Cauchy-Binet formula

    det S = |m_x x m_y|^2 + dilation (|m_x|^2 + |m_y|^2) + dilation^2,
    det S d^T S^-1 d = |d_x m_y - d_y m_x|^2 + dilation |d|^2,

sums of squares that lose no digits for needles, where the entries of S^-1 would cancel.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.splatting.rendering import Constants, Primitives, Rendering

PIXELS_AT_ONCE = 2048
NARROWEST = 0.125  # floors: the width of an edge's band, so that few pixels do not stand for all


class Splats(NamedTuple):
    """The M visible Gaussians, front to back."""

    centers: Tensor  # [M, 2], px
    axes: Tensor  # [M, 2, 3], projected principal axes, px
    opacities: Tensor  # [M]
    colors: Tensor  # [M, 3]
    dilation: float  # px^2

    def __repr__(self) -> str:
        return one_line(self)


def render(primitives: Primitives, camera: Camera, constants: Constants, *, edges: bool = False) -> Rendering:
    """Render Gaussians in the dtype of their means; gradients hold what passes the alpha floor with `edges`."""
    splats = project(primitives, camera, constants)
    parts = [
        composite(alphas_at(pixels, splats, constants, edges=edges), splats.colors)
        for pixels in pixel_centers(camera).to(primitives.means).split(PIXELS_AT_ONCE)
    ]
    image = torch.cat(parts).reshape(camera.height, camera.width, 4)  # [H, W, 4]
    return Rendering(image[..., :3], image[..., 3])


def project(primitives: Primitives, camera: Camera, constants: Constants) -> Splats:
    """The Gaussians beyond the near plane that are more opaque than the alpha floor, projected and sorted."""
    means, scales, quats, opacities, colors = primitives
    rotation = torch.as_tensor(camera.rotation.copy()).to(means)  # [3, 3]
    translation = torch.as_tensor(camera.world_to_camera[:3, 3].copy()).to(means)  # [3]
    local = means @ rotation.T + translation  # [N, 3]
    visible = ((local[:, 2] > constants.near) & (opacities > constants.alpha_floor)).nonzero()[:, 0]  # [M]
    visible = visible[torch.argsort(local[visible, 2].detach().float(), stable=True)]
    local, scales, quats = local[visible], scales[visible], quats[visible]
    depths = local[:, 2:]  # [M, 1]
    ratios = local[:, :2] / depths  # [M, 2]
    focal = means.new_tensor([camera.fx, camera.fy])  # [2]
    principal = means.new_tensor([camera.cx, camera.cy])  # [2]
    size = means.new_tensor([camera.width, camera.height])  # [2]
    margin = constants.frame_margin * size
    limited = ratios.clamp((-principal - margin) / focal, (size - principal + margin) / focal)  # [M, 2]
    jacobians = torch.cat(
        [torch.diag_embed(focal / depths), (-focal * limited / depths)[..., None]], dim=2
    )  # [M, 2, 3]
    axes = jacobians @ rotation @ rotations(quats) * scales[:, None, :]  # [M, 2, 3]
    return Splats(ratios * focal + principal, axes, opacities[visible], colors[visible], constants.dilation)


def rotations(quats: Tensor) -> Tensor:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4) in the order w, x, y, z, of any length but (nearly) zero.

    A quaternion shorter than 1e-12 gives no rotation and no gradient.
    """
    lengths = quats.norm(dim=1, keepdim=True)  # [N, 1]
    long_enough = lengths > Constants.shortest_quaternion
    unit = torch.where(long_enough, quats / torch.where(long_enough, lengths, 1.0), 0.0)  # [N, 4]
    w, x, y, z = unit.unbind(1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)


def alphas_at(pixels: Tensor, splats: Splats, constants: Constants, *, edges: bool = False) -> Tensor:
    """Alpha of each splat at each of P pixel centres (P, 2), in px: (P, M), zero where it is not drawn.

    A pixel jumps where the edge of a Gaussian, at the alpha floor, passes it.  With `edges` gradients have these jumps.  They are
    extrapolated from alphas between the floor and twice the floor, or the peak where that is lower.
    """
    alphas = densities_at(pixels, splats)  # [P, M]
    if edges:
        floor = constants.alpha_floor
        widths = (splats.opacities.detach().clamp(max=2.0 * floor) - floor).clamp(min=NARROWEST * floor)  # [M]
        parts = (4.0 - 6.0 * (alphas.detach() - floor) / widths) * (alphas <= 2.0 * floor)  # [P, M]
        alphas = alphas + floor / widths * parts * (alphas - alphas.detach())
    alphas = torch.where(alphas >= constants.alpha_floor, alphas.clamp(max=constants.alpha_cap), 0.0)
    return torch.where(transmittances(alphas) >= constants.min_transmittance, alphas, 0.0)


def densities_at(pixels: Tensor, splats: Splats) -> Tensor:
    """Opacity times Gaussian of each splat at each of P pixel centres (P, 2), in px: (P, M), before any threshold."""
    across, down = splats.axes.unbind(1)  # [M, 3] each
    determinants = torch.linalg.cross(across, down).square().sum(1) + splats.dilation * (
        across.square().sum(1) + down.square().sum(1) + splats.dilation
    )  # [M]
    dx, dy = (pixels[:, None] - splats.centers).unbind(2)  # [P, M] each
    numerators = (dx[..., None] * down - dy[..., None] * across).square().sum(2)  # [P, M]
    numerators = numerators + splats.dilation * (dx.square() + dy.square())
    distances = numerators / torch.where(determinants > 0, determinants, torch.inf)  # [P, M]
    return torch.where(determinants > 0, splats.opacities * torch.exp(-0.5 * distances), 0.0)  # [P, M]


def transmittances(alphas: Tensor) -> Tensor:
    """Transmittance (P, M) in front of each splat, from alphas (P, M)."""
    through = torch.cumprod(1.0 - alphas, dim=1)  # [P, M]
    return torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)


def composite(alphas: Tensor, colors: Tensor) -> Tensor:
    """Premultiplied colours and alpha (P, 4) of M splats with `colors` (M, 3) and `alphas` (P, M)."""
    weights = transmittances(alphas) * alphas  # [P, M]
    return torch.cat([weights @ colors, weights.sum(dim=1, keepdim=True)], dim=1)


def pixel_centers(camera: Camera) -> Tensor:
    """(H * W, 2) float32, row by row."""
    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    return torch.stack([columns, rows], dim=-1).reshape(-1, 2) + 0.5
