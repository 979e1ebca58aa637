"""Splatting by the C++ kernels, as a differentiable torch function."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from native import kernels
from native.threads import cores
from surrogate.splatting.rendering import Constants, Primitives, Rendering


def render(primitives: Primitives, camera: Camera, constants: Constants, **options: Any) -> Rendering:
    """Render Gaussians in float32.

    The options are `threads`, by default all available cores, `instruction_set`, by default the best of
    `kernels.instruction_sets()`, and `edges`.

    Raises ValueError naming the Gaussian and the attribute where a number is not finite.
    """
    picture = render_over(primitives, camera, (0.0, 0.0, 0.0), constants, **options)
    return Rendering(picture[..., :3], picture[..., 3])


def render_over(
    primitives: Primitives, camera: Camera, background: Sequence[float], constants: Constants, **options: Any
) -> Tensor:
    """The same over a `background` colour (3,), with alpha as the fourth channel: (H, W, 4)."""
    return _Splat.apply(*primitives, _View(camera, constants, tuple(map(float, background)), **options))


@dataclass(frozen=True, eq=False)
class _View:
    """The inputs of rendering beside the Gaussians."""

    camera: Camera
    constants: Constants
    background: tuple[float, ...]
    threads: int | None = None
    instruction_set: str = ""
    edges: bool = False


class _Splat(torch.autograd.Function):
    """The picture (H, W, 4) over a background, with alpha."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        *tensors, view = inputs
        ctx.save_for_backward(*tensors)  # so that torch refuses a backward pass after an in-place change
        ctx.view, ctx.threads = view, view.threads or cores()
        ctx.drawing = _drawing([_array(tensor) for tensor in tensors], view, ctx.threads)
        return torch.from_numpy(ctx.drawing.picture)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        arrays = kernels.backward(ctx.drawing, _array(gradients[0]), ctx.threads, ctx.view.edges)
        return *(torch.from_numpy(a).to(t.dtype) for a, t in zip(arrays, ctx.saved_tensors, strict=True)), None


def _drawing(arrays: list[NDArray[np.float32]], view: _View, threads: int) -> Any:
    camera, c = view.camera, view.constants
    intrinsics, size = (camera.fx, camera.fy, camera.cx, camera.cy), (camera.width, camera.height)
    constants = [getattr(c, name) for name in Constants.__annotations__]  # class variables among them
    try:
        return kernels.forward(
            arrays, camera.world_to_camera, intrinsics, size, constants, threads, view.instruction_set, view.background
        )
    except MemoryError as error:
        raise MemoryError(
            f"there is not enough memory to draw {len(arrays[0]):,} Gaussians in {camera.width} x {camera.height} pixels: "
            "draw fewer or smaller ones, or a smaller picture"
        ) from error


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().to(torch.float32).contiguous().numpy()
