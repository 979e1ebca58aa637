"""What a deformation is: offsets of every parameter of every Gaussian, as a function of the ensemble's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from torch import Tensor

from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings


@dataclass(frozen=True, eq=False)
class Offsets:
    """What is added to the unconstrained parameters of N Gaussians; shapes as in `Gaussians`."""

    means: Tensor  # [N, 3]
    log_scales: Tensor  # [N, 3]
    quats: Tensor  # [N, 4]
    opacity_logits: Tensor  # [N]
    colors: Tensor  # [N, 3 K]

    def applied_to(self, gaussians: Gaussians) -> Gaussians:
        """The deformed Gaussians."""
        return Gaussians(
            gaussians.means + self.means,
            gaussians.log_scales + self.log_scales,
            gaussians.quats + self.quats,
            gaussians.opacity_logits + self.opacity_logits,
            gaussians.colors + self.colors,
        )


class Deformation(Protocol):
    """Offsets as a differentiable function of the canonical Gaussians and the normalized parameters.

    An implementation joins `surrogate.deformation.KINDS` under its `kind`.
    """

    kind: ClassVar[str]
    per_gaussian: ClassVar[frozenset[str]]  # the names in `tensors` that have one row per Gaussian

    @classmethod
    def create(cls, gaussians: Gaussians, parameters: int, settings: TrainingSettings) -> Deformation:
        """A deformation by `parameters` many parameters that still moves nothing."""

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> Deformation:
        """The deformation that had these `tensors` and this `record`."""

    def offsets(self, gaussians: Gaussians, parameters: Tensor) -> Offsets:
        """Offsets at `parameters` (P,), float32, normalized to [-1, 1] over their bounds."""

    def deformed(self, gaussians: Gaussians, parameters: Tensor) -> Gaussians:
        """`offsets` applied to the Gaussians, perhaps faster."""

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is trained, by name."""

    def rates(self, settings: TrainingSettings) -> dict[str, float]:
        """Adam's rate for each of `tensors`."""

    def record(self) -> dict[str, Any]:
        """JSON values that `load` needs beside the tensors."""
