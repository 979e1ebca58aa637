"""Stage 2, F_sim: the canonical Gaussians deform with the simulation's parameters; both are optimized together."""

from __future__ import annotations

from surrogate.canonical import canonical_rates
from surrogate.deformation import Deformation
from surrogate.gaussians import NAMES, Gaussians
from surrogate.settings import TrainingSettings
from surrogate.stage import Stage

PREFIX = "deformation."


def simulation_stage(gaussians: Gaussians, deformation: Deformation, settings: TrainingSettings) -> Stage:
    """Optimize `gaussians` (at a reduced rate) and `deformation` in place."""
    canonical = {name: rate * settings.canonical_rate_factor for name, rate in canonical_rates(settings).items()}
    tensors = gaussians.tensors() | {PREFIX + name: tensor for name, tensor in deformation.tensors().items()}
    return Stage(
        name="deformation",
        steps=settings.deformation_steps,
        tensors={name: tensor.requires_grad_() for name, tensor in tensors.items()},
        rates=canonical | {PREFIX + name: rate for name, rate in deformation.rates(settings).items()},
        per_gaussian=frozenset(NAMES) | {PREFIX + name for name in deformation.per_gaussian},
        gaussians_at=lambda parameters: deformation.deformed(gaussians, parameters),
        rest_at=lambda parameters: gaussians,
    )
