"""One clean grid of samples: the only thing that is ever rendered.

VTK renders NaN and single slices silently wrong: they are refused here, before it sees them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.holes import continued

Triple = tuple[float, float, float]

SAMPLES = ("float32", "float64", "int32", "uint32", "int64", "uint64")
LARGEST = 1e100  # world units, whose square is finite, too
FLOAT32_INTEGERS = 1 << 24  # float32 holds every whole number up to here


@dataclass(frozen=True, eq=False)
class Grid:
    """Samples of a scalar field on a regular grid, aligned with the world axes.

    Attributes
    ----------
    values : (nz, ny, nx), finite, read-only; sample [k, j, i] lies at `origin + spacing * (i, j, k)`.  Between samples
        the field is trilinear; the volume ends at the first and last sample of each axis.  `to_grid` holds them in
        float32 where that is exact, else in the type that they came in (float64, or 32- or 64-bit integers).
    spacing, origin : world units, in the order x, y, z.
    holes : (nz, ny, nx) bool or None: samples without a value.  Every grid cell with a hole at a corner is
        transparent.  `values` there repeats the nearest of the 26 samples around that has one, so that gradients stay tame.
        Deeper inside it holds some value of the field, which no image shows.
    notes : what the user should know of how the samples were made, such as that they were resampled.

    Examples
    --------
    >>> import numpy as np
    >>> from render import to_grid
    >>> field = np.ones((4, 8, 8))
    >>> field[0] = np.nan  # land below an ocean
    >>> grid = to_grid(field, spacing=(0.5, 0.5, 1.0), nan="transparent")
    >>> grid.shape, int(grid.holes.sum())
    ((4, 8, 8), 64)
    """

    values: NDArray[Any]  # [nz, ny, nx]
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    holes: NDArray[np.bool_] | None = None  # [nz, ny, nx]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        values = self.values
        if values.dtype not in SAMPLES or values.ndim != 3:
            raise ValueError(
                f"a Grid holds values (nz, ny, nx) of one of the types {', '.join(SAMPLES)}, "
                f"got {values.dtype} {values.shape}: use to_grid"
            )
        if min(values.shape) < 2:
            raise ValueError(f"a volume needs at least 2 samples along every axis, got {values.shape} for (z, y, x)")
        if self.holes is not None and self.holes.shape != values.shape:
            raise ValueError(f"holes must have the shape of values {values.shape}, got {self.holes.shape}")
        object.__setattr__(self, "spacing", triple("spacing", self.spacing))
        object.__setattr__(self, "origin", triple("origin", self.origin))
        if min(self.spacing) <= 0:
            raise ValueError(f"spacing must be positive along x, y and z, got {self.spacing}")
        low, high = self.bounds
        if min(self.spacing) < 1 / LARGEST or np.abs((low, high)).max() > LARGEST or not (low < high).all():
            raise ValueError(
                f"samples at origin {self.origin} with spacing {self.spacing} coincide in double precision, or their squares "
                "overflow: choose another unit of length or another origin"
            )
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

    @cached_property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return float(self.values.min()), float(self.values.max())

    def minus(self, number: float) -> Iterator[NDArray[np.float64]]:
        """`values - number`, one z-slice (ny, nx) at a time, rounded once to float64 (where the machine has extended precision,
        which x86 has, also of integers beyond 2**53).
        """
        wide = np.longdouble if self.values.dtype in ("int64", "uint64") else np.float64
        for plane in self.values:
            yield (plane.astype(wide) - number).astype(np.float64, copy=False)

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        low, high = self.range
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
    if values.dtype.itemsize > 8:
        with np.errstate(over="ignore"):
            values = values.astype(np.float64)
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
    if holes.all():
        raise ValueError("not one value of the field is finite")
    place = triple("spacing", spacing), triple("origin", origin)
    if not holes.any():
        return Grid(np.array(values, dtype=_exact_type(values), order="C"), *place, None, notes)
    values = continued(values, holes)
    return Grid(np.asarray(values, dtype=_exact_type(values)), *place, holes, notes)


def _exact_type(values: NDArray[Any]) -> np.dtype[Any]:
    """float32 where that holds each of finite `values` exactly, else their own type."""
    single, own = np.dtype(np.float32), values.dtype.newbyteorder("=")
    if np.can_cast(own, single):
        return single
    if own.kind != "f":
        within = values.min() >= -FLOAT32_INTEGERS and values.max() <= FLOAT32_INTEGERS
        return single if within else own
    with np.errstate(over="ignore"):
        return single if all((plane.astype(single) == plane).all() for plane in values) else own


def triple(name: str, value: ArrayLike) -> Triple:
    """`value`, or one number for all, as (x, y, z); raises ValueError naming it `name` for anything else."""
    try:
        numbers = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,) if np.ndim(value) == 0 else np.shape(value))
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} must be three finite numbers (x, y, z), got {value!r}")
    x, y, z = map(float, numbers)
    return x, y, z
