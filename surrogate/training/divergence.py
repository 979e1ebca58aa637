"""Training that diverges: found before its numbers are kept, and told in one sentence."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from surrogate.gaussians import Gaussians


def first_infinite(tensors: Mapping[str, Tensor]) -> str:
    """The first number that is not finite, such as "scales[3, 0] is inf"; "" where all are finite."""
    for name, tensor in tensors.items():
        broken = ~tensor.detach().isfinite()
        if broken.any():
            place = tuple(broken.nonzero()[0].tolist())
            return f"{name}{list(place) if place else ''} is {float(tensor.detach()[place])}"
    return ""


@torch.no_grad()
def as_drawn(gaussians: Gaussians) -> dict[str, Tensor]:
    """All that must be finite to draw the Gaussians: a scale may be infinite though its logarithm is not."""
    return gaussians.tensors() | {"scales": gaussians.scales(), "opacities": gaussians.opacities()}


def divergence(stage: str, step: int, steps: int, what: str) -> ValueError:
    """The error of a training that can't go on."""
    return ValueError(
        f"training diverged in stage {stage} at step {step:,} of {steps:,}, where {what}: lower the rates in the scene's "
        "[training] table"
    )
