"""One clean grid of samples: the only thing that is ever rendered.

VTK renders NaN, single slices and numbers beyond single precision silently wrong: they are refused here, before it sees them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Triple = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Grid:
    """Samples of a scalar field on a regular grid, aligned with the world axes.

    Attributes
    ----------
    values : (nz, ny, nx) float32, finite, read-only; sample [k, j, i] lies at `origin + spacing * (i, j, k)`.
        Between samples the field is trilinear; the volume ends at the first and last sample of each axis.
    spacing, origin : world units, in the order x, y, z.
    holes : (nz, ny, nx) bool or None: samples without a value.  Every grid cell with a hole at a corner is
        transparent; `values` there repeats the nearest sample that has one, so that gradients stay tame.
    notes : what the user should know of how the samples were made, such as that they were resampled.
    """

    values: NDArray[np.float32]  # [nz, ny, nx]
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    holes: NDArray[np.bool_] | None = None  # [nz, ny, nx]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        values = self.values
        if values.dtype != np.float32 or values.ndim != 3:
            raise ValueError(
                f"a Grid holds float32 values (nz, ny, nx), got {values.dtype} {values.shape}: use to_grid"
            )
        if min(values.shape) < 2:
            raise ValueError(f"a volume needs at least 2 samples along every axis, got {values.shape} for (z, y, x)")
        if self.holes is not None and self.holes.shape != values.shape:
            raise ValueError(f"holes must have the shape of values {values.shape}, got {self.holes.shape}")
        object.__setattr__(self, "spacing", triple("spacing", self.spacing))
        object.__setattr__(self, "origin", triple("origin", self.origin))
        if min(self.spacing) <= 0:
            raise ValueError(f"spacing must be positive along x, y and z, got {self.spacing}")
        frozen = np.ascontiguousarray(values).view()
        frozen.setflags(write=False)
        object.__setattr__(self, "values", frozen)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Samples along (z, y, x)."""
        nz, ny, nx = self.values.shape
        return nz, ny, nx

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(low, high) corners (3,) of the box from the first to the last sample, world units."""
        low = np.array(self.origin)
        return low, low + np.array(self.spacing) * (np.array(self.shape[::-1]) - 1)

    @property
    def center(self) -> NDArray[np.float64]:
        """Middle of the box (3,), world units."""
        low, high = self.bounds
        return (low + high) / 2

    @property
    def bounding_radius(self) -> float:
        """Radius of the sphere around the box, world units."""
        low, high = self.bounds
        return float(np.linalg.norm(high - low)) / 2

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        low, high = self.values.min(), self.values.max()
        holes = f", {int(self.holes.sum())} holes" if self.holes is not None else ""
        return (
            f"Grid({nx} x {ny} x {nz} samples, spacing {self.spacing}, origin {self.origin}, "
            f"values {low:g} to {high:g}{holes})"
        )


def checked_grid(
    values: NDArray[Any],
    spacing: ArrayLike,
    origin: ArrayLike,
    nan: str,
    *,
    outside: NDArray[np.bool_] | None = None,
    notes: tuple[str, ...] = (),
) -> Grid:
    """A grid of real `values` (nz, ny, nx) of any type; samples `outside` the field are holes, whatever `nan` says.

    Raises ValueError or TypeError naming what is wrong with shape, type, range or values.
    """
    if nan not in ("refuse", "transparent"):
        raise ValueError(f'nan must be "refuse" or "transparent", got {nan!r}')
    if values.dtype.kind not in "fiub":
        raise TypeError(f"a field must hold real numbers, got {values.dtype}")
    if values.ndim != 3:
        raise ValueError(f"a field must have 3 axes (z, y, x), got {values.ndim} (shape {values.shape})")
    if min(values.shape) < 2:
        raise ValueError(f"a volume needs at least 2 samples along every axis, got {values.shape} for (z, y, x)")
    holes = ~np.isfinite(values)
    if outside is not None:
        holes &= ~outside
    if holes.any() and nan == "refuse":
        first = tuple(int(i) for i in np.argwhere(holes)[0])
        raise ValueError(
            f"{int(holes.sum())} of {values.size} values are NaN or infinite, the first at (z, y, x) = {first}: "
            'pass nan="transparent" to leave them out of the picture'
        )
    if outside is not None:
        holes |= outside
    place = triple("spacing", spacing), triple("origin", origin)
    return Grid(_float32(values, holes), *place, holes if holes.any() else None, notes)


def _float32(values: NDArray[Any], holes: NDArray[np.bool_]) -> NDArray[np.float32]:
    if holes.all():
        raise ValueError("not one value of the field is finite")
    if holes.any():
        from scipy.ndimage import distance_transform_edt

        nearest = distance_transform_edt(holes, return_distances=False, return_indices=True)  # [3, nz, ny, nx]
        values = values[tuple(nearest)]
    low, high = values.min(), values.max()
    limit = float(np.finfo(np.float32).max)
    if abs(float(low)) > limit or abs(float(high)) > limit:
        raise ValueError(
            f"values from {low:g} to {high:g} do not fit single precision (+-{limit:g}): rescale the field"
        )
    return np.array(values, dtype=np.float32, order="C")


def triple(name: str, value: ArrayLike) -> Triple:
    """`value`, or one number for all, as (x, y, z); raises ValueError calling it `name` where it is no such thing."""
    numbers = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,)) if np.ndim(value) == 0 else np.asarray(value)
    if numbers.shape != (3,) or not np.isfinite(numbers.astype(np.float64)).all():
        raise ValueError(f"{name} must be three finite numbers (x, y, z), got {value!r}")
    x, y, z = map(float, numbers)
    return x, y, z
