"""Coordinates that were printed with few digits: what they were before, as far as the digits say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insitu.fields.field import Field
from insitu.readers.arrays import LabelledArray
from insitu.readers.fortran_numbers import spelled

SLACK = 1e-9  # of a coordinate: what computing with it adds to its rounding


@dataclass(frozen=True, eq=False)
class PrintedAxis:
    """Coordinates along an axis, increasing, and how far each may lie from what was printed.

    Attributes
    ----------
    values, rounding : [n]; half a unit of the last digit that was printed.
    """

    values: NDArray[np.float64]  # [n]
    rounding: NDArray[np.float64]  # [n]

    @classmethod
    def of(cls, words: Sequence[str]) -> PrintedAxis:
        """The axis of printed numbers; raises ValueError for others, and where they do not increase."""
        try:
            numbers = [Decimal(spelled(word)) for word in words]
        except InvalidOperation:
            raise ValueError(f"coordinates must be numbers, got {' '.join(words)[:40]!r}") from None
        if not all(number.is_finite() for number in numbers):
            raise ValueError("coordinates must be finite")
        values = np.array([float(number) for number in numbers])
        if len(values) < 2 or not np.isfinite(values).all() or not (np.diff(values) > 0).all():
            raise ValueError(f"coordinates must be at least 2 and increase, got {' '.join(words[:4])} ...")
        return cls(values, np.array(_roundings(numbers)))

    def __len__(self) -> int:
        return len(self.values)

    @property
    def ends(self) -> tuple[float, float]:
        return float(self.values[0]), float(self.values[-1])

    @property
    def centers(self) -> NDArray[np.float64]:
        """Midpoints [n - 1] between neighbours."""
        return (self.values[1:] + self.values[:-1]) / 2

    @property
    def step(self) -> float | None:
        """The distance of neighbours, where the coordinates were evenly spaced as far as their digits say; else None.

        It is that of the line through the first and the last, which were printed with rounding errors themselves.
        """
        n = len(self.values) - 1
        first, last = self.ends
        share = np.arange(n + 1) / n
        line = first + share * (last - first)
        allowed = self.rounding + (1 - share) * self.rounding[0] + share * self.rounding[-1]
        allowed += SLACK * np.abs(self.values).max()
        return (last - first) / n if (np.abs(self.values - line) <= allowed).all() else None

    def meets(self, other: PrintedAxis) -> bool:
        """True if `other` begins where this one ends."""
        slack = self.rounding[-1] + other.rounding[0] + SLACK * abs(self.ends[1])
        return bool(abs(self.ends[1] - other.ends[0]) <= slack)


def field_on_axes(
    values: NDArray[Any], axes: Sequence[PrintedAxis], on_cells: bool, name: str, time: float | None = None
) -> Field | LabelledArray:
    """Values [nz, ny, nx] at the points of axes (x, y, z), or at the cells' centres: a field if even, else with coordinates."""
    x, y, z = (axis.step for axis in axes)
    if x is not None and y is not None and z is not None:
        half = 0.5 if on_cells else 0.0
        i, j, k = (axis.ends[0] for axis in axes)
        return Field(values, (x, y, z), (i + half * x, j + half * y, k + half * z), name, time=time)
    along = [axis.centers if on_cells else axis.values for axis in axes]
    return LabelledArray(values, ("z", "y", "x"), dict(zip("xyz", along, strict=True)), name, time=time)


def joined_axis(parts: Sequence[PrintedAxis]) -> tuple[PrintedAxis, list[int]]:
    """The axis of which each part is a piece, several maybe the same one, and the index at which each part begins.

    Raises ValueError where pieces overlap, or leave a gap.
    """
    pieces: list[PrintedAxis] = []
    numbers = []
    for number in sorted(range(len(parts)), key=lambda i: parts[i].ends):
        part = parts[number]
        if not pieces or not _is_same(pieces[-1], part):
            if pieces and not pieces[-1].meets(part):
                what = "overlap" if part.ends[0] < pieces[-1].ends[1] else "leave a gap"
                raise ValueError(f"they {what} between {pieces[-1].ends[1]:g} and {part.ends[0]:g}")
            pieces.append(part)
        numbers.append((number, len(pieces) - 1))
    begins = np.cumsum([0, *(len(piece) - 1 for piece in pieces)])
    values = np.concatenate([pieces[0].values, *(piece.values[1:] for piece in pieces[1:])])
    rounding = np.concatenate([pieces[0].rounding, *(piece.rounding[1:] for piece in pieces[1:])])
    return PrintedAxis(values, rounding), [int(begins[piece]) for _, piece in sorted(numbers)]


def _is_same(one: PrintedAxis, other: PrintedAxis) -> bool:
    if len(one) != len(other):
        return False
    slack = one.rounding + other.rounding + SLACK * np.abs(one.values)
    return bool((np.abs(one.values - other.values) <= slack).all())


def _roundings(numbers: Sequence[Decimal]) -> list[float]:
    """Half a unit of the last digit of each number, digits that were left out because they are zero included."""
    nonzero = [number for number in numbers if number]
    exponents = {int(number.as_tuple().exponent) for number in nonzero}
    digits = {len(number.as_tuple().digits) for number in nonzero}
    if len(exponents) == 1 or len(digits) == 1:  # as many behind the point, or in all
        places = [int(number.as_tuple().exponent) for number in numbers]
    else:
        places = [number.adjusted() - max(digits) + 1 for number in numbers]
    # What is printed as zero is zero: other numbers keep digits that are not.
    return [0.5 * 10.0**place if number else 0.0 for number, place in zip(numbers, places, strict=True)]
