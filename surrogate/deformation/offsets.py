"""The interface of deformations: offsets of all parameters of every Gaussian as functions of the ensemble's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import torch
from torch import Tensor

from catalogs.vocabulary.words import one_line
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings

# The change of each attribute that one unit of a deformation's output makes; lengths in half boxes.
UNITS = {"means": 0.05, "log_scales": 0.2, "quats": 0.1, "opacity_logits": 1.0, "colors": 0.5, "values": 0.1}


@dataclass(frozen=True, eq=False)
class Offsets:
    """Changes of the unconstrained parameters of N Gaussians; shapes as in `Gaussians`.

    Of the colours it is the first columns, usually 3: how a colour depends on the direction stays the same (Nyx, 5,000 steps:
    32.28 dB; 32.19 with all columns deformed).  Where Gaussians carry values of a field, these stand in the colours' place.
    """

    means: Tensor  # [N, 3]
    log_scales: Tensor  # [N, 3]
    quats: Tensor  # [N, 4]
    opacity_logits: Tensor  # [N]
    colors: Tensor  # [N, 3] or more; [N, 2] of values

    __repr__ = one_line

    def applied_to(self, gaussians: AnyGaussians) -> AnyGaussians:
        """The deformed Gaussians, with as many colour columns as the one or the other have: zeros fill the narrower."""
        geometry = (
            gaussians.means + self.means,
            gaussians.log_scales + self.log_scales,
            gaussians.quats + self.quats,
            gaussians.opacity_logits + self.opacity_logits,
        )
        if isinstance(gaussians, FieldGaussians):
            return gaussians.with_tensors((*geometry, gaussians.values + self.colors))
        columns = max(gaussians.colors.shape[1], self.colors.shape[1])
        return Gaussians(*geometry, _widened(gaussians.colors, columns) + _widened(self.colors, columns))


def _widened(table: Tensor, columns: int) -> Tensor:
    missing = columns - table.shape[1]
    return torch.nn.functional.pad(table, (0, missing)) if missing else table  # [N, columns]


class Deformation(Protocol):
    """Offsets as a differentiable function of the canonical Gaussians and the normalized parameters.

    An implementation joins `surrogate.deformation.READABLE` under its `kind`.
    """

    kind: ClassVar[str]

    @property
    def per_gaussian(self) -> frozenset[str]:
        """The names in `tensors` that have one row per Gaussian."""

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> Deformation:
        """The deformation that had these `tensors` and this `record`."""

    def offsets(self, gaussians: AnyGaussians, parameters: Tensor) -> Offsets:
        """Offsets at `parameters` (P,), float32, normalized to [-1, 1] over their bounds."""

    def deformed(self, gaussians: AnyGaussians, parameters: Tensor) -> AnyGaussians:
        """`offsets` applied to the Gaussians, perhaps faster."""

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is trained, by name."""

    def with_tensors(self, tensors: Mapping[str, Tensor]) -> Deformation:
        """The same with others for all of `tensors`."""

    def stored(self) -> dict[str, Tensor]:
        """The tensors that `load` needs: `tensors()` without frozen parts."""

    def of(self, rows: Tensor) -> Deformation:
        """The deformation of some of the Gaussians, by index (M,)."""

    def to(self, device: torch.device | torch.dtype) -> Deformation:
        """The same on another device, or in another precision."""

    def copy(self) -> Deformation:
        """The same numbers in tensors of their own."""

    def rates(self, settings: TrainingSettings) -> dict[str, float]:
        """Adam's rate for each of `tensors`."""

    def record(self) -> dict[str, Any]:
        """JSON values that `load` needs beside the tensors, and the `kind`."""
