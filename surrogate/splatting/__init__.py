"""Gaussians and a camera in, a picture out: one signature over every backend."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import torch
from torch import Tensor

from catalogs.cameras import Camera
from surrogate.splatting import cpu, cuda, reference
from surrogate.splatting.rendering import ALPHA_CAP, DILATION, Rendering

__all__ = ["BACKENDS", "Rendering", "render", "render_over"]

BACKENDS: dict[str, ModuleType] = {"cpu": cpu, "cuda": cuda, "reference": reference}
AUTO = "auto"  # the backend of the device that holds the Gaussians


def render(
    means: Tensor,
    scales: Tensor,
    quats: Tensor,
    opacities: Tensor,
    colors: Tensor,
    camera: Camera,
    *,
    near: float = 0.02,
    dilation: float = DILATION,
    alpha_floor: float = 1.0 / 255.0,
    alpha_cap: float = ALPHA_CAP,
    backend: str = AUTO,
    depth: bool = False,
    **options: Any,
) -> Rendering:
    """Draw N Gaussians as `camera` sees them; differentiable in all five tensors.

    Parameters
    ----------
    means : (N, 3) centres, world units.
    scales : (N, 3) standard deviations along the axes, world units, positive.
    quats : (N, 4) rotations w, x, y, z, of any length.
    opacities : (N,) opacity at the centre, in [0, 1].
    colors : (N, 3) colours, not limited to [0, 1].
    near : Gaussians whose centre is nearer than this, in world units along the axis, are not drawn.
    dilation : variance in pixels squared added to each projected Gaussian, so that one smaller than a pixel is seen at all;
        it also makes such Gaussians larger than they are.
    alpha_floor : contributions below it are left out; it bounds each Gaussian's extent.
    alpha_cap : alphas are cut to it, because one of 1 would let nothing through and have no derivative; below 1.
    backend : "cpu" (C++ kernels, float32), "cuda" (gsplat, float32; see `surrogate.splatting.cuda` for what differs), "reference"
        (plain torch in the dtype of `means`, slow: the definition) or "auto": "cuda" for tensors on a GPU, else "cpu".
    depth : also return the depth of the centres along the camera's axis, in world units, composited like a colour.
    options : `threads` and `instruction_set` of cpu, `screen_gradients` of cpu and cuda: a tensor (N,) that receives, in
        the backward pass, the length of the gradient by each projected centre in 1/px.

    Returns
    -------
    Rendering of premultiplied colour (H, W, 3), alpha (H, W) and, where asked for, premultiplied depth (H, W): divided by
    alpha it is the mean depth of what a pixel shows.  Depth costs a second drawing.

    A gradient by the camera's pose is had by moving the Gaussians: with a rigid motion R, t of the world in torch, draw
    R means + t and the quaternions multiplied by that of R.

    Sorting by centres is an approximation: Gaussians that interpenetrate are not integrated along the ray.
    """
    constants: dict[str, Any] = options | {
        "near": near,
        "dilation": dilation,
        "alpha_floor": alpha_floor,
        "alpha_cap": alpha_cap,
    }
    draw = _backend(backend, means).render
    rendering = draw(means, scales, quats, opacities, colors, camera, **constants)
    if not depth:
        return rendering
    constants.pop("screen_gradients", None)
    as_colors = _depths(means, camera)[:, None].expand(-1, 3)  # [N, 3]
    return rendering._replace(depth=draw(means, scales, quats, opacities, as_colors, camera, **constants).color[..., 0])


def render_over(
    means: Tensor,
    scales: Tensor,
    quats: Tensor,
    opacities: Tensor,
    colors: Tensor,
    camera: Camera,
    background: Sequence[float],
    *,
    near: float = 0.02,
    dilation: float = DILATION,
    alpha_floor: float = 1.0 / 255.0,
    alpha_cap: float = ALPHA_CAP,
    backend: str = AUTO,
    **options: Any,
) -> Tensor:
    """The picture of `render` over a `background` colour (3,), with alpha as its fourth channel: (H, W, 4).

    What training compares.  It is the same as `Rendering.over` and a concatenation, but the cpu backend writes it, and reads
    its gradient, in one pass; the other arguments are those of `render`.
    """
    constants: dict[str, Any] = options | {
        "near": near,
        "dilation": dilation,
        "alpha_floor": alpha_floor,
        "alpha_cap": alpha_cap,
    }
    gaussians = (means, scales, quats, opacities, colors)
    chosen = _backend(backend, means)
    if chosen is cpu:
        return cpu.render_over(*gaussians, camera, background, **constants)
    rendering = chosen.render(*gaussians, camera, **constants)
    return torch.cat([rendering.over(background), rendering.alpha.unsqueeze(-1)], dim=2)


def _backend(name: str, means: Tensor) -> ModuleType:
    if name == AUTO:
        return cuda if means.is_cuda else cpu
    if name not in BACKENDS:
        raise ValueError(f"backend must be one of {[AUTO, *sorted(BACKENDS)]}, got {name!r}")
    return BACKENDS[name]


def _depths(means: Tensor, camera: Camera) -> Tensor:
    """Depth of each centre along the camera's axis, (N,); in float64, and finite however far away the centre is."""
    axis = torch.tensor(camera.forward, device=means.device)  # [3]
    depths = means.double() @ axis + float(camera.world_to_camera[2, 3])  # [N]
    return depths.clamp(-torch.finfo(means.dtype).max, torch.finfo(means.dtype).max).to(means.dtype)
