"""The points at which each representation of an ensemble is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import one_line
from surrogate.model.field_model import FieldPoint
from surrogate.model.places import ParameterPoint


@dataclass(frozen=True, eq=False)
class BothPoints:
    """The same parameters for the Gaussians and for the emulated field."""

    gaussians: ParameterPoint
    field: FieldPoint

    __repr__ = one_line

    @property
    def simulation(self) -> NDArray[np.float64]:
        """Normalized parameters (P,) of the simulation."""
        return self.field.simulation

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence about each parameter that is out of bounds."""
        return self.field.warnings


AnyPoint = ParameterPoint | FieldPoint | BothPoints
