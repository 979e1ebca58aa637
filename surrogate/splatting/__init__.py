"""Gaussians and a camera in, a picture out: one signature over every backend."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import torch
from torch import Tensor

from catalogs.cameras import Camera
from surrogate.splatting import cpu, reference
from surrogate.splatting.rendering import ALPHA_CAP, DILATION, Rendering

__all__ = ["BACKENDS", "Rendering", "render", "render_over"]

BACKENDS: dict[str, ModuleType] = {"cpu": cpu, "reference": reference}


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
    backend: str = "cpu",
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
    backend : "cpu" (C++ kernels, float32) or "reference" (plain torch in the dtype of `means`, slow: the definition).
    depth : also return the depth of the centres along the camera's axis, in world units, composited like a colour.
    options : `threads`, `instruction_set` and `screen_gradients` of the cpu backend.  A tensor (N,) given as
        `screen_gradients` receives, in the backward pass, the length of the gradient by each projected centre in 1/px.

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
    draw = _backend(backend).render
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
    backend: str = "cpu",
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
    if backend == "cpu":
        return cpu.render_over(*gaussians, camera, background, **constants)
    rendering = _backend(backend).render(*gaussians, camera, **constants)
    return torch.cat([rendering.over(background), rendering.alpha.unsqueeze(-1)], dim=2)


def _backend(name: str) -> ModuleType:
    if name not in BACKENDS:
        raise ValueError(f"backend must be one of {sorted(BACKENDS)}, got {name!r}")
    return BACKENDS[name]


def _depths(means: Tensor, camera: Camera) -> Tensor:
    """Depth of each centre along the camera's axis, (N,); in float64, and finite however far away the centre is."""
    axis = torch.tensor(camera.forward)  # [3]
    depths = means.double() @ axis + float(camera.world_to_camera[2, 3])  # [N]
    return depths.clamp(-torch.finfo(means.dtype).max, torch.finfo(means.dtype).max).to(means.dtype)
