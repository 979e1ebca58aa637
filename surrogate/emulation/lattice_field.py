"""A field on a regular grid and the distribution that it is the mean of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.quantity import Quantity
from catalogs.vocabulary.words import one_line
from surrogate.emulation.corners import Vector
from surrogate.emulation.posterior import Posterior, ResampledPosterior


@dataclass(frozen=True, eq=False)
class LatticeField:
    """A field at one set of parameters.

    Attributes
    ----------
    values : (Z, Y, X) float32, in the field's unit; any finite number in holes.
    holes : (Z, Y, X) bool, True where the field has no value; None where there are no holes.
    spacing, origin : (x, y, z) in world units: sample [k, j, i] lies at origin + spacing * (i, j, k).
    posterior : the distribution that the values are the mean of; None for fields that are known.
    quantity : the field's name and unit.
    """

    values: NDArray[np.float32]  # [Z, Y, X]
    holes: NDArray[np.bool_] | None
    spacing: Vector
    origin: Vector
    posterior: Posterior | ResampledPosterior | None = None
    quantity: Quantity = Quantity()  # noqa: RUF009 - frozen

    __repr__ = one_line

    @property
    def deviations(self) -> NDArray[np.float32] | None:
        """Standard deviations (Z, Y, X) in the field's unit; None for fields that are known."""
        if self.posterior is None:
            return None
        return self.posterior.deviations().reshape(self.values.shape)
