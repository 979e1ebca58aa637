"""Anything that holds a scalar field (numpy, VTK, pyvista) as one clean grid of samples.

VTK renders NaN, single slices and unstructured grids silently wrong, so everything is decided here, loudly,
before it sees the data.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

NanPolicy = Literal["refuse", "transparent"]
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
    """

    values: NDArray[np.float32]  # [nz, ny, nx]
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    holes: NDArray[np.bool_] | None = None  # [nz, ny, nx]

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
        object.__setattr__(self, "spacing", _triple("spacing", self.spacing))
        object.__setattr__(self, "origin", _triple("origin", self.origin))
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


def to_grid(
    data: Any,
    *,
    spacing: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    array: str | None = None,
    nan: NanPolicy = "refuse",
) -> Grid:
    """A `Grid` of `data`.

    Parameters
    ----------
    data : a 3-D array indexed (z, y, x) of real numbers, a VTK or pyvista data set, or a `Grid` (returned as it is).
        What is masked in a masked array counts as NaN.
    spacing, origin : world units in the order (x, y, z), for arrays only (default: 1 and 0); data sets have their own.
    array : name of the point or cell array of a data set; may be left out where there is only one.
    nan : "refuse" raises ValueError where a value is NaN or infinite; "transparent" makes every grid cell
        with such a corner transparent (see `Grid.holes`).

    Image data are taken sample by sample: points where they are, cell values at the cell centres (so the box
    is half a cell smaller on each side, and no value is averaged with its neighbours).  Rectilinear, curvilinear
    and unstructured data are resampled with a `ResamplingWarning` that says how.

    Raises ValueError naming what is wrong with shape, type, range, spacing or values, and TypeError for data
    that are no field at all.
    """
    if isinstance(data, Grid):
        if spacing is not None or origin is not None:
            raise ValueError("a Grid has its own spacing and origin")
        return data
    if hasattr(data, "IsA") and hasattr(data, "GetClassName"):
        from render.datasets import samples_of

        if spacing is not None or origin is not None:
            raise ValueError(f"a {data.GetClassName()} has its own spacing and origin: leave them out")
        values, spacing, origin, outside = samples_of(data, array)
        return _grid(values, spacing, origin, nan, outside)
    if array is not None:
        raise ValueError(f"array={array!r} names an array of a VTK data set, but the data are {type(data).__name__}")
    values = _unmasked(data) if isinstance(data, np.ma.MaskedArray) else np.asarray(data)
    return _grid(values, spacing if spacing is not None else 1.0, origin if origin is not None else 0.0, nan)


def _unmasked(data: Any) -> NDArray[Any]:
    """A masked array of real numbers as plain values, NaN where it is masked."""
    if data.dtype.kind not in "fiub" or not np.ma.is_masked(data):
        return np.asarray(data.data)
    return np.asarray(data.astype(data.dtype if data.dtype.kind == "f" else np.float64).filled(np.nan))


def _grid(
    values: NDArray[Any],
    spacing: ArrayLike,
    origin: ArrayLike,
    nan: NanPolicy,
    outside: NDArray[np.bool_] | None = None,
) -> Grid:
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
    return Grid(_float32(values, holes), _triple("spacing", spacing), _triple("origin", origin), _some(holes))


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


def _some(holes: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    return holes if holes.any() else None


def _triple(name: str, value: ArrayLike) -> Triple:
    numbers = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,)) if np.ndim(value) == 0 else np.asarray(value)
    if numbers.shape != (3,) or not np.isfinite(numbers.astype(np.float64)).all():
        raise ValueError(f"{name} must be three finite numbers (x, y, z), got {value!r}")
    x, y, z = map(float, numbers)
    return x, y, z


class ResamplingWarning(UserWarning):
    """The data are not on a regular grid and were interpolated onto one."""


def warn_resampled(what: str) -> None:
    """Say loudly that, and how, data were resampled."""
    warnings.warn(what, ResamplingWarning, stacklevel=4)
