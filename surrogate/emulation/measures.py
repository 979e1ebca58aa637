"""Numbers of a field at one set of parameters: samples, profiles, slices, histograms and statistics of a box, with errors.

Values of holes are left out.  Standard deviations are None for fields that are known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.numbers import count, finite, row
from catalogs.vocabulary.words import one_line
from surrogate.emulation.corners import Corners
from surrogate.emulation.lattice_field import LatticeField

Array = NDArray[np.float64]

DRAWS, SEED = 64, 0  # of the posterior, for what has no closed form: their deviations are right to 9 %
NUMBERS = MINIMUM, MAXIMUM, MEAN, SHARE = "minimum", "maximum", "mean", "share_above"
AXES = ("x", "y", "z")
Box = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class Sampled:
    """Values and their standard deviations (...) at places (..., 3) in world units; NaN beside holes and outside the box."""

    places: Array  # [..., 3]
    values: Array  # [...]
    deviations: Array | None  # [...]

    __repr__ = one_line


@dataclass(frozen=True)
class Measured:
    """A number with its standard deviation, None where it is known."""

    value: float
    deviation: float | None

    def __str__(self) -> str:
        return f"{self.value:.6g}" if self.deviation is None else f"{self.value:.6g} ± {self.deviation:.2g}"


@dataclass(frozen=True)
class Statistics:
    """A box's least, greatest and mean value, and the share of its samples above a level, None without one."""

    minimum: Measured
    maximum: Measured
    mean: Measured
    share_above: Measured | None


@dataclass(frozen=True, eq=False)
class Histogram:
    """The shares (B,) of a box's samples in bins of B + 1 edges, and their standard deviations."""

    edges: Array  # [B + 1]
    shares: Array  # [B]
    deviations: Array | None  # [B]

    __repr__ = one_line


def sample(field: LatticeField, places: ArrayLike) -> Sampled:
    """The field at world places (N, 3), trilinear."""
    points = np.asarray(places, dtype=np.float64)
    corners = Corners.of(points, field.values.shape, field.spacing, field.origin)
    holes = None if field.holes is None else field.holes.ravel()
    if field.posterior is None:
        return Sampled(points, corners.average(field.values.ravel(), holes), None)
    return Sampled(points, *field.posterior.sample(corners, holes))


def profile(field: LatticeField, start: ArrayLike, end: ArrayLike, number: int = 100) -> Sampled:
    """The field at `number` places, evenly from one world place to another."""
    shares = np.linspace(0.0, 1.0, count(number, "number of places"))[:, None]
    first, last = (np.array(row(place, 3, "end of a profile")) for place in (start, end))
    return sample(field, first + shares * (last - first))


def plane(field: LatticeField, axis: str, coordinate: float) -> Sampled:
    """The slice across an axis, "x", "y" or "z", at a world coordinate: the samples of the other two axes, [., .] in z, y, x."""
    if axis not in AXES:
        raise ValueError(f"axis must be one of x, y, z, got {axis!r}")
    across = AXES.index(axis)
    low, high = _axis(field, across)[[0, -1]]
    if not low <= finite(coordinate, "coordinate") <= high:
        raise ValueError(f"the field reaches from {axis} = {low:g} to {high:g}, got the coordinate {coordinate:g}")
    lines = [np.array([coordinate]) if i == across else _axis(field, i) for i in range(3)]
    z, y, x = np.meshgrid(*lines[::-1], indexing="ij")
    places = np.stack([x, y, z], -1).squeeze(2 - across)  # [., ., 3]
    samples = sample(field, places.reshape(-1, 3))
    shape = places.shape[:2]
    deviations = None if samples.deviations is None else samples.deviations.reshape(shape)
    return Sampled(places, samples.values.reshape(shape), deviations)


def statistics(
    field: LatticeField, box: Box | None = None, level: float | None = None, *, draws: int = DRAWS, seed: int = SEED
) -> Statistics:
    """Of the samples in a box, its lower and upper corner in world units; None: everywhere.

    Deviations are those of fields drawn from the posterior, about the value of the mean field.  Factors make 90 % intervals of the
    whole field and its octants hold for members that were left out.  At parameters drawn like the members' that promises 90 %
    with nine members or more, n / (n + 1) with n.  Raises ValueError for a box without a sample that has a value.
    """
    above = np.nan if level is None else finite(level, "level")
    values, deviations = _with_draws(field, box, lambda v: box_numbers(v, above), NUMBERS, draws, seed)
    least, most, mean, share = (
        Measured(float(value), None if deviations is None else float(deviations[i])) for i, value in enumerate(values)
    )
    return Statistics(least, most, mean, None if level is None else share)


def box_numbers(values: NDArray[Any], level: float) -> Array:
    """The `NUMBERS` (..., 4) of the samples (..., N) of a box."""
    extremes = values.min(-1), values.max(-1)
    return np.stack(
        [*extremes, values.mean(-1, dtype=np.float64), np.count_nonzero(values > level, -1) / values.shape[-1]],
        -1,
        dtype=np.float64,
    )


def histogram(
    field: LatticeField, edges: ArrayLike, box: Box | None = None, *, draws: int = DRAWS, seed: int = SEED
) -> Histogram:
    """Of the samples in a box in bins between increasing `edges` (B + 1,); the last holds its upper edge.

    Deviations are made to hold like those of the share above a level, see `statistics`.
    """
    bounds = np.asarray(edges, dtype=np.float64)
    if bounds.ndim != 1 or len(bounds) < 2 or not np.isfinite(bounds).all() or not (np.diff(bounds) > 0.0).all():
        raise ValueError(f"edges must be two or more increasing numbers, got {edges!r}")

    def shares(values: NDArray[Any]) -> Array:
        return np.histogram(values, bounds)[0] / len(values)

    return Histogram(bounds, *_with_draws(field, box, shares, [SHARE] * (len(bounds) - 1), draws, seed))


def _with_draws(
    field: LatticeField,
    box: Box | None,
    measured: Callable[[NDArray[Any]], Array],
    names: Sequence[str],
    draws: int,
    seed: int,
) -> tuple[Array, Array | None]:
    """Numbers of these names of the field's values in a box, and their standard deviations by fields of the posterior."""
    inside = _inside(field, box)
    values = measured(field.values.ravel()[inside])
    if field.posterior is None:
        return values, None
    others = [measured(sample[inside]) for sample in field.posterior.draws(count(draws, "draws"), seed)]
    deviations = np.sqrt(np.mean((np.array(others) - values) ** 2, axis=0, dtype=np.float64))
    return values, deviations * [field.posterior.factors.get(name, 1.0) for name in names]


def _inside(field: LatticeField, box: Box | None) -> NDArray[np.int64]:
    """Positions of the samples in a box that have a value."""
    selected = np.ones(field.values.shape, bool) if field.holes is None else ~field.holes
    if box is not None:
        low, high = (row(corner, 3, "corner of a box") for corner in box)
        for i in range(3):
            line = _axis(field, i)
            within = (line >= low[i]) & (line <= high[i])
            selected = selected & np.expand_dims(within, tuple(a for a in range(3) if a != 2 - i))
    indices = np.flatnonzero(selected)
    if not len(indices):
        extent = ", ".join(f"{a} {_axis(field, i)[0]:g}..{_axis(field, i)[-1]:g}" for i, a in enumerate(AXES))
        raise ValueError(f"no sample with a value lies in the box {box}: the field has {extent}")
    return indices


def _axis(field: LatticeField, axis: int) -> Array:
    """World coordinates of the samples along x, 0, y, 1, or z, 2."""
    steps = np.arange(field.values.shape[2 - axis], dtype=np.float64)
    return field.origin[axis] + field.spacing[axis] * steps
