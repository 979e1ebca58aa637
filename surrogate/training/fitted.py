"""What stages 1 and 2 fit: Gaussians, and how they follow the simulation's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor

from surrogate.deformation import Deformation, load_deformation
from surrogate.gaussians import Gaussians
from surrogate.storage.names import joined, part_of


class Fitted(NamedTuple):
    """Canonical Gaussians and their deformation, F_sim."""

    gaussians: Gaussians
    deformation: Deformation

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> Fitted:
        """What had these `tensors()` and this `record()`."""
        deformation = load_deformation(part_of(tensors, "deformation"), record)
        return cls(Gaussians(**part_of(tensors, "gaussians")), deformation)

    def copy(self) -> Fitted:
        """The same numbers in tensors of their own."""
        return Fitted(self.gaussians.copy(), self.deformation.copy())

    def to(self, device: torch.device) -> Fitted:
        """The same on another device."""
        return Fitted(self.gaussians.to(device), self.deformation.to(device))

    def at(self, parameters: Tensor) -> Gaussians:
        """The Gaussians at normalized parameters (P,)."""
        return self.deformation.deformed(self.gaussians, parameters)

    def without(self, attribute: str) -> Fitted:
        """The same with one of the Gaussians' attributes held still."""
        return Fitted(self.gaussians, self.deformation.without(attribute))

    def of(self, rows: Tensor) -> Fitted:
        """The same with only some Gaussians, by index (M,)."""
        return Fitted(self.gaussians.of(rows), self.deformation.of(rows))

    def tensors(self) -> dict[str, Tensor]:
        """All that would be stored."""
        return joined({"gaussians": self.gaussians.tensors(), "deformation": self.deformation.stored()})

    def record(self) -> dict[str, Any]:
        """JSON values that `load` needs beside the tensors."""
        return self.deformation.record()

    @property
    def megabytes(self) -> float:
        """10^6 bytes in float32."""
        return 4e-6 * sum(tensor.numel() for tensor in self.tensors().values())
