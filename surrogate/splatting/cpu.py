"""Splatting by the C++ kernels, as a differentiable torch function."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

import native
from catalogs.cameras import Camera
from surrogate.splatting.rendering import ALPHA_CAP, Rendering


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
    alpha_cap: float = ALPHA_CAP,
    threads: int | None = None,
    instruction_set: str = "",
    screen_gradients: Tensor | None = None,
) -> Rendering:
    """Draw Gaussians in float32; arguments as `surrogate.splatting.render`.

    `threads` defaults to the cores this process may use, `instruction_set` to the best of `native.instruction_sets()`.
    Raises ValueError naming the Gaussian and the attribute where a number is not finite.
    """
    constants = _Constants(
        camera, near, dilation, alpha_floor, alpha_cap, threads or cores(), instruction_set, screen_gradients
    )
    return Rendering(*_Splat.apply(means, scales, quats, opacities, colors, constants))


def render_over(
    means: Tensor,
    scales: Tensor,
    quats: Tensor,
    opacities: Tensor,
    colors: Tensor,
    camera: Camera,
    background: Sequence[float],
    *,
    near: float,
    dilation: float,
    alpha_floor: float,
    alpha_cap: float = ALPHA_CAP,
    threads: int | None = None,
    instruction_set: str = "",
    screen_gradients: Tensor | None = None,
) -> Tensor:
    """Draw Gaussians in float32; arguments as `surrogate.splatting.render_over` and `render`."""
    behind = tuple(map(float, background))
    constants = _Constants(
        camera, near, dilation, alpha_floor, alpha_cap, threads or cores(), instruction_set, screen_gradients, behind
    )
    return _Splat.apply(means, scales, quats, opacities, colors, constants)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True, eq=False)
class _Constants:
    camera: Camera
    near: float
    dilation: float
    alpha_floor: float
    alpha_cap: float
    threads: int
    instruction_set: str
    screen_gradients: Tensor | None
    background: tuple[float, ...] | None = None


class _Splat(torch.autograd.Function):
    """Colour (H, W, 3) and alpha (H, W), or, with a background, one picture (H, W, 4)."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor | tuple[Tensor, Tensor]:
        *tensors, constants = inputs
        ctx.save_for_backward(*tensors)  # only so that torch refuses a backward after one was changed in place
        ctx.constants = constants
        ctx.drawing = _drawn([_array(tensor) for tensor in tensors], constants)
        if constants.background is not None:
            return torch.from_numpy(ctx.drawing.over)
        return torch.from_numpy(ctx.drawing.color), torch.from_numpy(ctx.drawing.alpha)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        tensors, constants = ctx.saved_tensors, ctx.constants
        backward = native.backward if constants.background is None else native.backward_over
        *arrays, screen = backward(ctx.drawing, *(_array(gradient) for gradient in gradients), constants.threads)
        if constants.screen_gradients is not None:
            constants.screen_gradients.copy_(torch.from_numpy(screen))
        return *(torch.from_numpy(a).to(t.dtype) for a, t in zip(arrays, tensors, strict=True)), None


def _drawn(arrays: list[NDArray[np.float32]], constants: _Constants) -> Any:
    camera = constants.camera
    try:
        return native.forward(
            *arrays,
            camera.world_to_camera,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
            camera.width,
            camera.height,
            constants.near,
            constants.dilation,
            constants.alpha_floor,
            constants.threads,
            constants.instruction_set,
            constants.background,
            constants.alpha_cap,
        )
    except MemoryError as error:
        raise MemoryError(
            f"there is not enough memory to draw {len(arrays[0]):,} Gaussians in {camera.width} x {camera.height} pixels: "
            "draw fewer or smaller ones, or a smaller picture"
        ) from error


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().to(torch.float32).contiguous().numpy()
