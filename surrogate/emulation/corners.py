"""Places in a field on a regular grid: the samples around them, trilinear interpolation, and other grids over its box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.numbers import count, row
from catalogs.vocabulary.words import one_line

Vector = tuple[float, float, float]
Shape = tuple[int, int, int]
BEYOND = 1e-6  # of a step, by which places may lie outside the box: rounding
MOST_SAMPLES = 1 << 28  # of a resampled field: 1 GiB


def vector(values: Any, what: str) -> Vector:
    """Three finite numbers; raises ValueError naming `what` for anything else."""
    x, y, z = row(values, 3, what)
    return x, y, z


@dataclass(frozen=True, eq=False)
class Corners:
    """The samples around N places, and their weights in trilinear interpolation; NaN weights for places outside the box."""

    indices: NDArray[np.int64]  # [N, 8], of the flattened field
    weights: NDArray[np.float64]  # [N, 8]

    __repr__ = one_line

    @classmethod
    def of(cls, places: ArrayLike, shape: tuple[int, ...], spacing: Vector, origin: Vector) -> Corners:
        """Of world places (N, 3), in a field of a shape (Z, Y, X); raises ValueError unless they are finite."""
        points = np.asarray(places, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise ValueError(f"places must be N finite points (x, y, z), got an array of shape {list(points.shape)}")
        last = np.array(shape[::-1]) - 1  # [3], (x, y, z)
        steps = (points - origin) / spacing  # [N, 3]
        outside = ((steps < -BEYOND) | (steps > last + BEYOND)).any(1)  # [N]
        steps = np.clip(steps, 0.0, last)
        low = np.minimum(steps.astype(np.int64), np.maximum(last - 1, 0))  # [N, 3]
        share = steps - low  # [N, 3]
        strides = np.array([1, shape[2], shape[1] * shape[2]])
        corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])  # [8, 3]
        indices = np.minimum(low[:, None] + corners, last) @ strides  # [N, 8]
        weights = np.where(corners, share[:, None], 1.0 - share[:, None]).prod(2)  # [N, 8]
        weights[outside] = np.nan
        return cls(indices, weights)

    def average(self, values: NDArray[np.floating], holes: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Interpolated `values` (..., V) at the places, (..., N); NaN beside holes (V,) and outside the box."""
        averages = np.einsum("...nc,nc->...n", values[..., self.indices], self.weights, optimize=True)
        if holes is not None:
            averages[..., (holes[self.indices] & (self.weights > 0.0)).any(1)] = np.nan
        return averages


def resampled(values: NDArray[np.float32], shape: Shape) -> NDArray[np.float32]:
    """A field (Z, Y, X) on as many samples as `shape` says, from its first to its last along each axis: trilinear."""
    for axis, side in enumerate(shape):
        last = values.shape[axis] - 1
        places = np.linspace(0.0, last, side)
        low = places.astype(np.int64)
        share = (places - low).astype(np.float32).reshape(-1, *(1,) * (2 - axis))
        high = np.minimum(low + 1, last)
        values = values.take(low, axis) * (1.0 - share) + values.take(high, axis) * share
    return values


def other_shape(sides: Any, before: Shape) -> Shape:
    """Numbers of samples (Z, Y, X) for a field that has `before`; raises ValueError for what doesn't span its box."""
    z, y, x = (
        count(side, "each side of a field's shape") for side in row(sides, 3, "the shape of a field, (z, y, x),")
    )
    for axis, side, old in zip("zyx", (z, y, x), before, strict=True):
        if (side == 1) != (old == 1):
            wanted = "1 sample, as the field has" if old == 1 else "2 samples or more"
            raise ValueError(f"the shape of a field must have {wanted} along {axis}, got {side}")
    if z * y * x > MOST_SAMPLES:
        raise ValueError(f"a field has at most {MOST_SAMPLES:,} samples, got {x} x {y} x {z}")
    return z, y, x
