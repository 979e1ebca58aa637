"""Time of rendering one scene, and the error of image and gradients against the float64 reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from research.benchmarks.splatting.reference_patches import (
    Errors,
    ReferenceDrawing,
    gradient_error,
    image_errors,
    picture_at,
)
from research.benchmarks.splatting.workloads import View
from research.benchmarks.timing import MeasuredTime, measured_in_turn
from surrogate.splatting import Primitives, Rendering, draw


@dataclass(frozen=True)
class DrawingMeasurement:
    """Milliseconds of the forward pass, the backward pass and both; errors of the image and of the gradients."""

    forward: MeasuredTime
    backward: MeasuredTime
    both: MeasuredTime
    image: Errors
    gradient: float

    def times(self) -> list[str]:
        """Times of the forward pass, the backward pass and both, for a table."""
        return [str(self.forward), str(self.backward), str(self.both)]

    def error_cells(self) -> list[str]:
        """PSNR, largest difference and largest gradient error, for a table."""
        return [f"{self.image.decibels:.1f}", f"{self.image.largest:.0e}", f"{self.gradient:.0e}"]


TIMES = ("forward, ms", "backward, ms", "sum, ms")
ERROR_HEADER = ("PSNR against float64, dB", "largest image error", "largest gradient error")


def measure(view: View, exact: ReferenceDrawing, seconds: float, **options: Any) -> DrawingMeasurement:
    """Render and differentiate for `seconds`, then compare with the reference."""
    leaves = Primitives(*(tensor.clone().requires_grad_() for tensor in view.scene))
    view, camera = view._replace(scene=leaves), view.camera
    wait = torch.cuda.synchronize if leaves.means.is_cuda else lambda: None
    random = torch.Generator().manual_seed(3)
    by_color, by_alpha = (
        torch.randn(camera.height, camera.width, *channels, generator=random, dtype=leaves.means.dtype).to(leaves.means)
        for channels in ((3,), ())
    )
    drawn: list[Rendering] = []

    def forward() -> None:
        drawn[:] = [draw(*view, **options)]
        wait()

    def backward() -> None:
        torch.autograd.grad((drawn[0].color, drawn[0].alpha), leaves, (by_color, by_alpha))
        wait()

    forward_ms, backward_ms, both = measured_in_turn([forward, backward], seconds)
    image, gradient = errors(view, exact, **options)
    return DrawingMeasurement(forward_ms, backward_ms, both, image, gradient)


def errors(view: View, exact: ReferenceDrawing, **options: Any) -> tuple[Errors, float]:
    """Errors of the image, and of the gradients of the reference's functional (nan where it has none)."""
    drawn = draw(*view, **options)
    picture = picture_at(Rendering(drawn.color.cpu(), drawn.alpha.cpu()), exact.pixels)  # [P, 4]
    if not exact.gradients:
        return image_errors(picture, exact), float("nan")
    gradients = torch.autograd.grad((picture * exact.weights.to(picture)).sum(), view.scene)
    return image_errors(picture, exact), gradient_error([gradient.cpu() for gradient in gradients], exact)
