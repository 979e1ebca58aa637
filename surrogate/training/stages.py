"""What a stage of training optimizes, how fast, and how it makes the Gaussians of a member: the first two of them.

Stage 1 fits one set of Gaussians to all members at once, as well as one can.  In stage 2, F_sim, these deform with the simulation's
parameters, and both are optimized together.  Stage 3 is in `training.visualizations`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from torch import Tensor

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.appearance.field_gaussians import AnyGaussians
from surrogate.deformation import KINDS, Deformation
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings

PREFIX = "deformation."
WARM_UP, WARM_UP_SHARE = 500, 0.05  # steps, at most so many of a stage's


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
    rest_at : what the stage's deformation acts on, there; None where it has none.
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
    rest_at: Callable[[Tensor], Gaussians] | None = None

    def gaussians_at(self, parameters: Tensor) -> Gaussians:
        """The Gaussians that are drawn at normalized parameters (P,)."""
        return self.carried_at(parameters).drawn(self.function_at(parameters))

    def warmth(self, step: int) -> float:
        """What the rates of `warming` tensors are multiplied by in a step: they rise linearly at first.

        Where 5 % of the pixels show anything, most of what the first steps say is that Gaussians shall not be seen.  At full rates
        F_sim learnt that within a few hundred steps for all members, and no gradient brought the Gaussians back.
        """
        return min(1.0, (step + 1) / min(WARM_UP, max(1.0, WARM_UP_SHARE * self.steps)))


def canonical_rates(gaussians: AnyGaussians, settings: TrainingSettings) -> dict[str, float]:
    """Adam's rates for the tensors of Gaussians."""
    return {name: getattr(settings.rates, name) for name in gaussians.tensors()}


def canonical_stage(gaussians: AnyGaussians, settings: TrainingSettings) -> Stage:
    """Optimize `gaussians` in place; every member looks the same."""
    return Stage(
        name="canonical",
        steps=settings.steps.canonical,
        tensors={name: tensor.requires_grad_() for name, tensor in gaussians.tensors().items()},
        rates=canonical_rates(gaussians, settings),
        per_gaussian=frozenset(gaussians.tensors()),
        carried_at=lambda _: gaussians,
    )


def new_deformation(gaussians: AnyGaussians, parameters: int, settings: TrainingSettings) -> Deformation:
    """F_sim before stage 2, by `parameters` many parameters: it moves nothing yet, and never what is to be held still."""
    deformation: Deformation = KINDS[settings.designs.simulation].create(gaussians, parameters, settings)
    for name in settings.designs.held_still:
        deformation = deformation.without(name)
    return deformation


def shared_of(deformation: Deformation, prefix: str) -> frozenset[str]:
    """The tensors of a deformation that have no row per Gaussian, by name after a prefix."""
    return frozenset(prefix + name for name in deformation.tensors() if name not in deformation.per_gaussian)


def simulation_stage(gaussians: AnyGaussians, deformation: Deformation, settings: TrainingSettings) -> Stage:
    """Optimize `gaussians` (at a reduced rate) and `deformation` in place."""
    canonical = {
        name: rate * settings.rates.canonical_factor for name, rate in canonical_rates(gaussians, settings).items()
    }
    tensors = gaussians.tensors() | {PREFIX + name: tensor for name, tensor in deformation.tensors().items()}
    return Stage(
        name="deformation",
        steps=settings.steps.deformation,
        tensors={name: tensor.requires_grad_() for name, tensor in tensors.items()},
        rates=canonical | {PREFIX + name: rate for name, rate in deformation.rates(settings).items()},
        per_gaussian=frozenset(gaussians.tensors()) | {PREFIX + name for name in deformation.per_gaussian},
        carried_at=lambda parameters: deformation.deformed(gaussians, parameters),
        shared=shared_of(deformation, PREFIX),
        warming=frozenset(PREFIX + name for name in deformation.tensors()),
        rest_at=lambda parameters: gaussians.drawn(),
    )
