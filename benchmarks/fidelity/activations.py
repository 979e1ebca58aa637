"""From an unconstrained number to an opacity: alternatives to the sigmoid.

1 - exp(-softplus(x)), an optical depth kept positive by softplus, is the sigmoid itself: exp(-softplus(x)) = 1 / (1 + e^x).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from surrogate.gaussians import Gaussians


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
    """The Gaussians that `surrogate` knows, whose opacities are those that the activation gives; differentiable."""
    if name == "sigmoid":
        return gaussians
    opacities = ACTIVATIONS[name].opacity(gaussians.opacity_logits).clamp(1e-7, 1.0 - 1e-6)  # [N]
    return Gaussians(gaussians.means, gaussians.log_scales, gaussians.quats, torch.logit(opacities), gaussians.colors)
