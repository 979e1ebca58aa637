"""Stages of training, each with its tensors, rates and Gaussians of a member: the first two of them.

Stage 1 fits one set of Gaussians to all members at once, as well as one can.  In stage 2 these deform with the simulation's
parameters, and both are optimized together.  Stage 3 is in `training.visualizations`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from torch import Tensor

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.appearance.field_gaussians import AnyGaussians
from surrogate.deformation import BilinearDeformation, Deformation
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings

PREFIX = "deformation."
# Adam's step sizes for the Gaussians' tensors at the start of a stage; lengths in half boxes.
RATES = {
    "means": 3e-3,
    "log_scales": 6e-3,
    "quats": 3e-3,
    "opacity_logits": 6e-2,
    "colors": 5e-3,
    "values": 1e-3,
}
FINAL_FACTOR = 0.2  # of all rates, reached exponentially at the end of a stage
COOLDOWN = 0.3  # share of a stage: its last steps, in which all rates fall to 0 as well
WARM_UP, WARM_UP_SHARE = 500, 0.05  # steps, at most this share of a stage's


@dataclass(frozen=True, eq=False)
class Stage:
    """One stage.

    Attributes
    ----------
    name : "canonical", "deformation", or the kind of a variation.
    steps : its length.
    tensors : the leaf tensors that are optimized, by name; those of the Gaussians under the names in `Gaussians`.
    rates : Adam's rate per tensor at the stage's start.
    per_gaussian : which of them have a row per Gaussian that moves when a dead Gaussian is relocated; none: nothing is relocated.
    shared : which of them move all Gaussians at once.
    warming : which of them begin slowly, see `warmth`.
    carried_at : the Gaussians at normalized parameters (P,) with the colours or values they carry, differentiable in `tensors`.
    function_at : the transfer function that is shown there of the values that they carry; None for the base.
    final_factor : see `decay`.
    """

    name: str
    steps: int
    tensors: Mapping[str, Tensor]
    rates: Mapping[str, float]
    per_gaussian: frozenset[str]
    carried_at: Callable[[Tensor], AnyGaussians]
    shared: frozenset[str] = frozenset()
    warming: frozenset[str] = frozenset()
    function_at: Callable[[Tensor], TransferFunction | None] = lambda _: None
    final_factor: float = FINAL_FACTOR

    def gaussians_at(self, parameters: Tensor) -> Gaussians:
        """The Gaussians that are drawn at normalized parameters (P,)."""
        return self.carried_at(parameters).drawn(self.function_at(parameters))

    def warmth(self, step: int) -> float:
        """The factor of the rates of `warming` tensors in a step: they rise linearly at first.

        Where 5 % of the pixels show anything, most of what the first steps say is that Gaussians shall not be seen.  At full rates
        the deformation learnt that within a few hundred steps for all members, and no gradient brought the Gaussians back.
        """
        return min(1.0, (step + 1) / min(WARM_UP, max(1.0, WARM_UP_SHARE * self.steps)))


def decay(done: float, final_factor: float = FINAL_FACTOR) -> float:
    """The factor of all rates once this part of a stage, from 0 to 1, is done.

    The exponential fall of 3D Gaussian splatting, times a linear one to 0 at the end (Hägele et al. 2024, "Scaling laws and
    compute-optimal training beyond fixed training durations"): steps that still wander leave noise in the last images.
    """
    return final_factor**done * min(1.0, (1.0 - done) / COOLDOWN)


def canonical_rates(gaussians: AnyGaussians) -> dict[str, float]:
    """Adam's rates for the tensors of Gaussians."""
    return {name: RATES[name] for name in gaussians.tensors()}


def canonical_stage(gaussians: AnyGaussians, settings: TrainingSettings) -> Stage:
    """Optimize `gaussians` in place; every member looks the same."""
    return Stage(
        name="canonical",
        steps=settings.canonical_steps,
        tensors={name: tensor.requires_grad_() for name, tensor in gaussians.tensors().items()},
        rates=canonical_rates(gaussians),
        per_gaussian=frozenset(gaussians.tensors()),
        carried_at=lambda _: gaussians,
    )


def new_deformation(gaussians: AnyGaussians, parameters: int, settings: TrainingSettings) -> BilinearDeformation:
    """The simulation deformation before stage 2, by `parameters` many parameters: it moves nothing yet."""
    return BilinearDeformation.create(gaussians, parameters, settings)


def shared_of(deformation: Deformation, prefix: str) -> frozenset[str]:
    """The tensors of a deformation that have no row per Gaussian, by name after a prefix."""
    return frozenset(prefix + name for name in deformation.tensors() if name not in deformation.per_gaussian)


def simulation_stage(gaussians: AnyGaussians, deformation: Deformation, settings: TrainingSettings) -> Stage:
    """Optimize `gaussians` and `deformation` in place."""
    tensors = gaussians.tensors() | {PREFIX + name: tensor for name, tensor in deformation.tensors().items()}
    return Stage(
        name="deformation",
        steps=settings.deformation_steps,
        tensors={name: tensor.requires_grad_() for name, tensor in tensors.items()},
        rates=canonical_rates(gaussians) | {PREFIX + name: rate for name, rate in deformation.rates(settings).items()},
        per_gaussian=frozenset(gaussians.tensors()) | {PREFIX + name for name in deformation.per_gaussian},
        carried_at=lambda parameters: deformation.deformed(gaussians, parameters),
        shared=shared_of(deformation, PREFIX),
        warming=frozenset(PREFIX + name for name in deformation.tensors()),
    )
