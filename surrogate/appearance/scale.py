"""The scale on which Gaussians carry values of a field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.numbers import row
from catalogs.vocabulary.words import one_line

FEWEST_BETWEEN = 1e-6  # of the range, between two knots
AT_ONCE = 1 << 14  # places whose numbers stay in a core's cache: four times as fast as a whole field of 64³


@dataclass(frozen=True, eq=False)
class ValueScale:
    """A piecewise linear scale, 0 at the first of K increasing `knots` (field values), 1 at the last, even steps between them.

    So what a transfer function tells apart by a control point lies equally far apart, however unevenly the points lie in the
    field's unit.
    """

    knots: NDArray[np.float64]  # [K]

    __repr__ = one_line

    def __post_init__(self) -> None:
        knots = np.asarray(self.knots, dtype=np.float64)
        if knots.ndim != 1 or len(knots) < 2 or not np.isfinite(knots).all() or not (np.diff(knots) > 0).all():
            raise ValueError(f"the knots of a scale of values must be at least two increasing numbers, got {knots}")
        object.__setattr__(self, "knots", knots)

    @classmethod
    def of_function(cls, function: TransferFunction) -> ValueScale:
        """The scale whose knots are the control points of a function's colour and opacity."""
        places = np.unique([p[0] for p in function.color_points + function.opacity_points])  # [K]
        apart = np.diff(places) > FEWEST_BETWEEN * (places[-1] - places[0])
        return cls(places[np.concatenate([[True], apart])])

    @classmethod
    def from_json(cls, knots: Any) -> ValueScale:
        """The scale of `to_json`; raises ValueError for what is none."""
        return cls(np.array(row(knots, len(knots) if isinstance(knots, list) else 0, "knots")))

    def to_json(self) -> list[float]:
        """The knots."""
        return [float(knot) for knot in self.knots]

    def places(self, values: ArrayLike) -> NDArray[np.float64]:
        """Field values (...) on the scale, (...): in [0, 1] between the ends, and going on as evenly beyond them."""
        values = np.asarray(values, dtype=np.float64)
        last = len(self.knots) - 1
        low = np.clip(np.searchsorted(self.knots, values, side="right") - 1, 0, last - 1)  # (...)
        shares = (values - self.knots[low]) / (self.knots[low + 1] - self.knots[low])
        return (low + shares) / last

    def values(self, places: ArrayLike) -> NDArray[np.float64]:
        """The field values (...) at places on the scale."""
        places = np.asarray(places)
        values = np.empty(places.shape)  # (...)
        apart, flat = np.diff(self.knots), places.ravel()
        for start in range(0, values.size, AT_ONCE):
            some = values.reshape(-1)[start : start + AT_ONCE]  # [A], in steps from the first knot, then values
            np.multiply(flat[start : start + AT_ONCE], len(self.knots) - 1, out=some, dtype=np.float64)
            low = np.fmin(np.fmax(some, 0.0), len(self.knots) - 2).astype(np.intp)  # [A]
            some -= low
            some *= apart.take(low)
            some += self.knots.take(low)
        return values

    def slopes(self, places: ArrayLike) -> NDArray[np.float64]:
        """Derivatives (...) of `values` at places on the scale; at a knot, beyond it."""
        steps = np.diff(self.knots) * (len(self.knots) - 1)  # [K - 1]
        low = np.floor(np.asarray(places, dtype=np.float64) * (len(self.knots) - 1)).astype(np.int64)
        return steps[np.clip(low, 0, len(steps) - 1)]
