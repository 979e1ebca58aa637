"""Variants of fitting one member, one change at a time: settings as data, and alternatives to the sigmoid.

1 - exp(-softplus(x)), an optical depth kept positive by softplus, is the sigmoid itself: exp(-softplus(x)) = 1 / (1 + e^x).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from surrogate.gaussians import Gaussians

STEPS = 6_000
GAUSSIANS = 20_000
BASE = "as it is"


@dataclass(frozen=True)
class Activation:
    """An opacity in [0, 1] from a number, and the number for an opacity."""

    opacity: Callable[[Tensor], Tensor]
    number: Callable[[float], float]


ACTIVATIONS: Mapping[str, Activation] = {
    "sigmoid": Activation(torch.sigmoid, lambda opacity: math.log(opacity / (1.0 - opacity))),
    "optical depth": Activation(lambda x: -torch.expm1(-x.exp()), lambda opacity: math.log(-math.log1p(-opacity))),
    "cut": Activation(lambda x: x.clamp(0.0, 1.0), lambda opacity: opacity),
}


def with_activation(gaussians: Gaussians, name: str) -> Gaussians:
    """Gaussians of `surrogate` whose opacities are those of the activation; differentiable."""
    if name == "sigmoid":
        return gaussians
    opacities = ACTIVATIONS[name].opacity(gaussians.opacity_logits).clamp(1e-7, 1.0 - 1e-6)  # [N]
    return Gaussians(gaussians.means, gaussians.log_scales, gaussians.quats, torch.logit(opacities), gaussians.colors)


@dataclass(frozen=True, eq=False)
class FidelityVariant:
    """One fit.

    Attributes
    ----------
    group, name : the question, and this answer to it.
    settings : values of `TrainingSettings` that replace those of every fit.
    activation : of `ACTIVATIONS`.
    """

    group: str
    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    activation: str = "sigmoid"

    @property
    def key(self) -> str:
        """A file name."""
        return "".join(c if c.isalnum() or c in ".-" else "_" for c in f"{self.group}-{self.name}")


def _variants() -> list[FidelityVariant]:
    still = {"relocation_interval": 0}
    return [
        FidelityVariant(BASE, "seed 0"),
        *(FidelityVariant(BASE, f"seed {seed}", {"seed": seed}) for seed in (1, 2)),
        *(FidelityVariant("Gaussians", f"{n:,}", {"gaussians": n}) for n in (5_000, 10_000, 40_000, 80_000)),
        *(FidelityVariant("steps", f"{n:,}", {"canonical_steps": n}) for n in (3_000, 12_000, 24_000)),
        FidelityVariant("colour degree", "1", {"color_degree": 1}),
        FidelityVariant("opacity (none relocated)", "sigmoid", still),
        FidelityVariant("opacity (none relocated)", "1 - exp(-exp x)", still, "optical depth"),
        FidelityVariant("opacity (none relocated)", "x cut to [0, 1]", still, "cut"),
    ]


VARIANTS = _variants()  # the others are compared with the first ones, which differ only by chance
