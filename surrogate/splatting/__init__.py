"""Gaussians and a camera in, a picture out: one signature over every backend."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from catalogs.cameras import Camera
from surrogate.splatting import cpu, reference
from surrogate.splatting.rendering import Rendering

__all__ = ["BACKENDS", "Rendering", "render"]

BACKENDS = {"cpu": cpu.render, "reference": reference.render}


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
    if backend not in BACKENDS:
        raise ValueError(f"backend must be one of {sorted(BACKENDS)}, got {backend!r}")
    constants = {"near": near, "dilation": dilation, "alpha_floor": alpha_floor}
    return BACKENDS[backend](means, scales, quats, opacities, colors, camera, **constants, **options)
