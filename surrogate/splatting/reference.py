"""The definition of splatting, in plain torch: slow, readable, differentiable, at any precision.

Gaussians are projected by EWA splatting (Zwicker, Pfister, van Baar & Gross 2002; Kerbl et al. 2023, section 4) and
composited front to back in the order of their centres' depth:

    alpha_i(p) = min(cap, opacity_i exp(-1/2 d^T conic_i d)),   d = p - centre_i,
    color(p)   = sum_i T_i alpha_i color_i,    T_i = prod_{j<i} (1 - alpha_j).

Contributions with alpha below the floor are left out, and so is what follows once T_i < 1e-4.  Every other backend is
tested against this one, forward and backward.
"""

from __future__ import annotations

import torch
from torch import Tensor

from catalogs.cameras import Camera
from surrogate.splatting.rendering import ALPHA_CAP, FRAME_MARGIN, MIN_TRANSMITTANCE, Rendering

PIXELS_AT_ONCE = 4096


def render(
    means: Tensor,
    scales: Tensor,
    quats: Tensor,
    opacities: Tensor,
    colors: Tensor,
    camera: Camera,
    *,
    near: float,
    dilation: float,
    alpha_floor: float,
) -> Rendering:
    """Draw Gaussians; arguments as `surrogate.splatting.render`, the result in the dtype of `means`."""
    centers, covariances, depths = project(means, scales, quats, camera, dilation=dilation)
    determinants = covariances.det()  # [N]
    drawn = (depths > near) & (opacities > alpha_floor) & (determinants > 0)  # [N]
    chosen = drawn.nonzero()[:, 0]  # [M]
    chosen = chosen[torch.argsort(depths[chosen].detach().float(), stable=True)]
    centers, colors, opacities = centers[chosen], colors[chosen], opacities[chosen]
    conics = torch.linalg.inv(covariances[chosen])  # [M, 2, 2]
    pixels = _pixel_centers(camera).to(means)  # [P, 2]
    parts = [
        _composite(block, centers, conics, opacities, colors, alpha_floor) for block in pixels.split(PIXELS_AT_ONCE)
    ]
    image = torch.cat(parts).reshape(camera.height, camera.width, 4)  # [H, W, 4]
    return Rendering(image[..., :3], image[..., 3])


def project(
    means: Tensor, scales: Tensor, quats: Tensor, camera: Camera, *, dilation: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Centres (N, 2) in pixels, covariances (N, 2, 2) in pixels squared with `dilation` added, and depths (N,)."""
    rotation = torch.as_tensor(camera.rotation.copy()).to(means)  # [3, 3]
    translation = torch.as_tensor(camera.world_to_camera[:3, 3].copy()).to(means)  # [3]
    local = means @ rotation.T + translation  # [N, 3]
    depths = local[:, 2]  # [N]
    ratios = local[:, :2] / depths[:, None]  # [N, 2]
    focal = means.new_tensor([camera.fx, camera.fy])  # [2]
    principal = means.new_tensor([camera.cx, camera.cy])  # [2]
    size = means.new_tensor([camera.width, camera.height])  # [2]
    margin = FRAME_MARGIN * size / focal  # [2]
    limited = ratios.clamp(-principal / focal - margin, (size - principal) / focal + margin)  # [N, 2]
    jacobians = torch.cat(
        [torch.diag_embed(focal / depths[:, None]), (-focal * limited / depths[:, None])[..., None]], dim=2
    )  # [N, 2, 3]
    axes = jacobians @ rotation @ rotations(quats) * scales[:, None, :]  # [N, 2, 3]
    covariances = axes @ axes.mT + dilation * torch.eye(2).to(means)  # [N, 2, 2]
    return ratios * focal + principal, covariances, depths


def rotations(quats: Tensor) -> Tensor:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4) in the order w, x, y, z, of any length; zero gives identity."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=1, eps=1e-12).unbind(1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)


def _composite(
    pixels: Tensor, centers: Tensor, conics: Tensor, opacities: Tensor, colors: Tensor, alpha_floor: float
) -> Tensor:
    offsets = pixels[:, None] - centers  # [P, M, 2]
    exponents = -0.5 * torch.einsum("pmi,mij,pmj->pm", offsets, conics, offsets)  # [P, M]
    alphas = opacities * exponents.exp()  # [P, M]
    alphas = torch.where(alphas >= alpha_floor, alphas.clamp(max=ALPHA_CAP), 0.0)
    through = torch.cumprod(1.0 - alphas, dim=1)  # [P, M]
    before = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)  # [P, M]
    alphas = torch.where(before >= MIN_TRANSMITTANCE, alphas, 0.0)
    through = torch.cumprod(1.0 - alphas, dim=1)
    before = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)
    weights = before * alphas  # [P, M]
    return torch.cat([weights @ colors, weights.sum(dim=1, keepdim=True)], dim=1)  # [P, 4]


def _pixel_centers(camera: Camera) -> Tensor:
    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    return torch.stack([columns, rows], dim=-1).reshape(-1, 2) + 0.5  # [P, 2]
