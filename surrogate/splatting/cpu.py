"""Splatting by the C++ kernels, as a differentiable torch function."""

from __future__ import annotations

import os
from typing import Any

import torch
from torch import Tensor

import native
from catalogs.cameras import Camera
from surrogate.splatting.rendering import Rendering


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
    threads: int | None = None,
    instruction_set: str = "",
    screen_gradients: Tensor | None = None,
) -> Rendering:
    """Draw Gaussians in float32; arguments as `surrogate.splatting.render`.

    `threads` defaults to the cores this process may use, `instruction_set` to the best of `native.instruction_sets()`.
    Raises ValueError naming the Gaussian and the attribute where a number is not finite.
    """
    constants = (camera, near, dilation, alpha_floor, threads or cores(), instruction_set, screen_gradients)
    color, alpha = _Splat.apply(means, scales, quats, opacities, colors, constants)
    return Rendering(color, alpha)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Splat(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor]:
        *tensors, constants = inputs
        camera, near, dilation, alpha_floor, threads, instruction_set, ctx.screen_gradients = constants
        ctx.save_for_backward(*tensors)  # only so that torch refuses a backward after one was changed in place
        arrays = [t.detach().to(torch.float32).contiguous().numpy() for t in tensors]
        ctx.threads, ctx.dtypes = threads, [t.dtype for t in tensors]
        ctx.drawing = native.forward(
            *arrays,
            camera.world_to_camera,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
            camera.width,
            camera.height,
            near,
            dilation,
            alpha_floor,
            threads,
            instruction_set,
        )
        return torch.from_numpy(ctx.drawing.color), torch.from_numpy(ctx.drawing.alpha)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        _ = ctx.saved_tensors
        color, alpha = (g.to(torch.float32).contiguous().numpy() for g in gradients)
        *arrays, screen = native.backward(ctx.drawing, color, alpha, ctx.threads)
        if ctx.screen_gradients is not None:
            ctx.screen_gradients.copy_(torch.from_numpy(screen))
        return *(torch.from_numpy(a).to(d) for a, d in zip(arrays, ctx.dtypes, strict=True)), None
