"""One scene drawn one way: how long it takes, and how far picture and gradients are from the float64 twin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from benchmarks.splatting.twin import Errors, Twin, gradient_error, image_errors, picture_at
from benchmarks.timing import Measured, measured_in_turn
from catalogs.cameras import Camera
from surrogate.splatting import Constants, Primitives, Rendering, draw


@dataclass(frozen=True)
class Drawn:
    """Milliseconds of the forward pass, the backward pass and both; errors of the picture and of the gradients."""

    forward: Measured
    backward: Measured
    both: Measured
    image: Errors
    gradient: float

    def error_cells(self) -> list[str]:
        """PSNR, largest difference, largest gradient error."""
        return [*error_cells(self.image), f"{self.gradient:.0e}"]


ERROR_HEADER = ("PSNR against float64, dB", "largest image error", "largest gradient error")


def error_cells(errors: Errors) -> list[str]:
    return [f"{errors.decibels:.1f}", f"{errors.largest:.0e}"]


def measure(
    scene: Primitives, camera: Camera, constants: Constants, twin: Twin, seconds: float, **options: Any
) -> Drawn:
    """Draw and differentiate for `seconds`, then compare with the twin."""
    leaves = Primitives(*(tensor.clone().requires_grad_() for tensor in scene))
    wait = torch.cuda.synchronize if scene.means.is_cuda else lambda: None
    random = torch.Generator().manual_seed(3)
    by_color = torch.randn(camera.height, camera.width, 3, generator=random, dtype=scene.means.dtype).to(
        scene.means.device
    )
    by_alpha = torch.randn(camera.height, camera.width, generator=random, dtype=scene.means.dtype).to(
        scene.means.device
    )
    drawn: list[Rendering] = []

    def forward() -> None:
        drawn[:] = [draw(leaves, camera, constants, **options)]
        wait()

    def backward() -> None:
        torch.autograd.grad((drawn[0].color, drawn[0].alpha), leaves, (by_color, by_alpha))
        wait()

    forward_ms, backward_ms, both = measured_in_turn([forward, backward], seconds)
    image, gradient = errors(leaves, camera, constants, twin, **options)
    return Drawn(forward_ms, backward_ms, both, image, gradient)


def errors(
    leaves: Primitives, camera: Camera, constants: Constants, twin: Twin, **options: Any
) -> tuple[Errors, float]:
    """Errors of the picture, and of the gradients of the twin's functional (nan where the twin has none)."""
    drawn = draw(leaves, camera, constants, **options)
    picture = picture_at(Rendering(drawn.color.cpu(), drawn.alpha.cpu()), twin.pixels)  # [P, 4]
    if not twin.gradients:
        return image_errors(picture, twin), float("nan")
    found = torch.autograd.grad((picture * twin.weights.to(picture)).sum(), leaves)
    return image_errors(picture, twin), gradient_error([gradient.cpu() for gradient in found], twin)
