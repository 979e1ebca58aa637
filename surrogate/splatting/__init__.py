"""Gaussians and a camera in, a picture out: one signature over every backend."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import torch
from torch import Tensor

from catalogs.cameras import Camera
from surrogate.splatting import cpu, reference
from surrogate.splatting.rendering import Rendering

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
    dilation: float = 0.1,
    alpha_floor: float = 1.0 / 255.0,
    backend: str = "cpu",
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
    backend : "cpu" (C++ kernels, float32) or "reference" (plain torch in the dtype of `means`, slow: the definition).
    options : `threads`, `instruction_set` and `screen_gradients` of the cpu backend.  A tensor (N,) given as
        `screen_gradients` receives, in the backward pass, the length of the gradient by each projected centre in 1/px.

    Returns
    -------
    Rendering of premultiplied colour (H, W, 3) and alpha (H, W).

    Sorting by centres is an approximation: Gaussians that interpenetrate are not integrated along the ray.
    """
    constants: dict[str, Any] = {"near": near, "dilation": dilation, "alpha_floor": alpha_floor, **options}
    return _backend(backend).render(means, scales, quats, opacities, colors, camera, **constants)


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
    dilation: float = 0.1,
    alpha_floor: float = 1.0 / 255.0,
    backend: str = "cpu",
    **options: Any,
) -> Tensor:
    """The picture of `render` over a `background` colour (3,), with alpha as its fourth channel: (H, W, 4).

    What training compares.  It is the same as `Rendering.over` and a concatenation, but the cpu backend writes it, and reads
    its gradient, in one pass; the other arguments are those of `render`.
    """
    constants: dict[str, Any] = {"near": near, "dilation": dilation, "alpha_floor": alpha_floor, **options}
    gaussians = (means, scales, quats, opacities, colors)
    if backend == "cpu":
        return cpu.render_over(*gaussians, camera, background, **constants)
    rendering = _backend(backend).render(*gaussians, camera, **constants)
    return torch.cat([rendering.over(background), rendering.alpha.unsqueeze(-1)], dim=2)


def _backend(name: str) -> ModuleType:
    if name not in BACKENDS:
        raise ValueError(f"backend must be one of {sorted(BACKENDS)}, got {name!r}")
    return BACKENDS[name]
