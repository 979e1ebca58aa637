"""Arrays whose axes and coordinates have names, such as xarray's, in the order and at the place that a grid has.

Nothing here imports xarray: an array is labelled that has `dims` and `coords`; a data set, `data_vars`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.grids import triple

AXES = "xyz"
# What axes are called, in lower case; those of a model's levels and of the Earth stand for z, y and x.
NAMES = {
    "x": {"x", "xc", "x_c", "lon", "longitude", "easting"},
    "y": {"y", "yc", "y_c", "lat", "latitude", "northing"},
    "z": {"z", "zc", "z_c", "lev", "level", "plev", "pressure_level", "depth", "height", "altitude", "elevation"},
}
SAME = 1e-5  # relative deviation of a spacing, or of an origin in spacings, that still agrees with coordinates


@dataclass(frozen=True, eq=False)
class PlacedArray:
    """Values (nz, ny, nx) of any real type, and where they lie.

    Attributes
    ----------
    axes : increasing coordinates along x, y and z; None where no axis has any.
    name, unit : of the quantity, "" where unknown.
    """

    values: NDArray[Any]  # [nz, ny, nx]
    axes: tuple[NDArray[Any], NDArray[Any], NDArray[Any]] | None
    name: str
    unit: str


def is_labelled(data: Any) -> bool:
    """True if `data` is one array with named axes."""
    # Not "values": merely to ask for them would load them.
    return all(hasattr(data, name) for name in ("dims", "coords", "shape")) and not is_labelled_set(data)


def is_labelled_set(data: Any) -> bool:
    """True if `data` holds several labelled arrays by name, such as an xarray.Dataset."""
    return hasattr(data, "data_vars") and hasattr(data, "dims")


def chosen(data: Any, array: str | None) -> Any:
    """The array of a labelled set that is asked for, or the only one with three axes; raises ValueError listing them."""
    held = [str(name) for name in data.data_vars]
    if array is not None:
        if array not in held:
            raise ValueError(f"no array {array!r} in the {type(data).__name__}: it has {held or 'none'}")
        return data[array]
    volumes = [name for name in held if _extents(data[name]) >= 3]
    if len(volumes) != 1:
        raise ValueError(f"name the array to render: the {type(data).__name__} has {volumes or held or 'none'}")
    return data[volumes[0]]


def placed(
    data: Any,
    dims: Sequence[str] | None = None,
    spacing: ArrayLike | None = None,
    origin: ArrayLike | None = None,
) -> PlacedArray:
    """A labelled array as (z, y, x) values with increasing coordinates.

    Parameters
    ----------
    dims : what its axes are, in their own order, each of "x", "y" and "z"; by default as they are called.
    spacing, origin : must agree with the coordinates where there are any.

    Axes of one value, such as a time, are dropped.  Raises ValueError naming axes that do not say what they are, coordinates
    that neither increase nor decrease, and a spacing or origin that contradicts them.
    """
    names = [str(name) for name in data.dims]
    kept = [name for name, size in zip(names, data.shape, strict=True) if size != 1] if len(names) > 3 else names
    if len(kept) != 3:
        raise ValueError(
            f"a field has 3 axes, this array has {names} of {tuple(data.shape)} values: choose one value along those that "
            f"are not in space, such as .isel({names[0] if names else 'time'}=0)"
        )
    coordinates = {name: data.coords[name] for name in names if name in data.coords}
    order = axis_order(kept, dims, {name: getattr(c, "attrs", {}) for name, c in coordinates.items()})
    values = np.asarray(data.values)
    values = values.reshape([n for n, name in zip(values.shape, names, strict=True) if name in kept])
    values = values.transpose([kept.index(order[letter]) for letter in "zyx"])
    attributes = getattr(data, "attrs", {})
    labels = str(getattr(data, "name", None) or ""), str(attributes.get("units", ""))
    along = {letter: coordinates.get(order[letter]) for letter in AXES}
    if all(coordinate is None for coordinate in along.values()):
        return PlacedArray(values, None, *labels)
    bare = [letter for letter in AXES if along[letter] is None]
    if bare and spacing is None:
        raise ValueError(
            f"the array has coordinates along {[order[a] for a in AXES if a not in bare]} but none along "
            f"{[order[letter] for letter in bare]}: give spacing (x, y, z), or the coordinates"
        )
    axes = []
    for number, letter in enumerate(AXES):
        size = values.shape[2 - number]
        axis = _increasing(along[letter], order[letter], size)
        if axis is None:
            start = 0.0 if origin is None else triple("origin", origin)[number]
            axis = start + triple("spacing", 1.0 if spacing is None else spacing)[number] * np.arange(size)
        elif axis[0] > axis[-1]:
            axis, values = axis[::-1], np.flip(values, 2 - number)
        axes.append(axis)
    _check_given(axes, order, spacing, origin)
    x, y, z = axes
    return PlacedArray(values, (x, y, z), *labels)


def axis_order(
    names: Sequence[str], dims: Sequence[str] | None, attributes: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, str]:
    """The name of the x, the y and the z axis among three `names`; `attributes` of their coordinates may say (CF's `axis`).

    Raises ValueError where `dims` is not an order of x, y and z, or where it is left out and the names do not say.
    """
    if dims is not None:
        letters = [str(letter).lower() for letter in dims]
        if sorted(letters) != sorted(AXES):
            raise ValueError(f'dims must be an order of "x", "y" and "z", one for each axis of the array, got {dims!r}')
    else:
        letters = [_letter(name, (attributes or {}).get(name, {})) for name in names]
        if sorted(letters) != sorted(AXES):
            raise ValueError(
                f"the axes {list(names)} do not say which of them is x, y and z: pass dims, what each axis is in the array's own "
                'order, such as dims=("z", "y", "x")'
            )
    return dict(zip(letters, names, strict=True))


def _letter(name: str, attributes: Mapping[str, Any]) -> str:
    """ "x", "y" or "z"; "" where neither the axis attribute nor the name says."""
    stated = str(attributes.get("axis", "")).lower()
    return next((letter for letter in AXES if letter == stated or (not stated and name.lower() in NAMES[letter])), "")


def _extents(array: Any) -> int:
    """Along how many axes an array has more than one value; 0 for what holds no numbers."""
    return sum(size > 1 for size in array.shape) if array.dtype.kind in "fiub" else 0


def _increasing(coordinate: Any, name: str, size: int) -> NDArray[Any] | None:
    """Coordinates along an axis; raises ValueError where they are not numbers that increase or decrease."""
    if coordinate is None:
        return None
    values = np.asarray(getattr(coordinate, "values", coordinate))
    if values.dtype.kind not in "fiu" or values.shape != (size,):
        raise ValueError(
            f"the coordinates along {name!r} must be {size} real numbers, got {values.dtype} {values.shape}"
        )
    values = values if values.dtype.kind == "f" else values.astype(np.float64)
    steps = np.diff(values)
    if not np.isfinite(values).all() or not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError(f"the coordinates along {name!r} must be finite and increase or decrease strictly")
    return values


def _check_given(
    axes: Sequence[NDArray[Any]], order: Mapping[str, str], spacing: ArrayLike | None, origin: ArrayLike | None
) -> None:
    """Raise ValueError where a spacing or origin that was given is not the coordinates'."""
    for number, (letter, axis) in enumerate(zip(AXES, axes, strict=True)):
        if len(axis) < 2:
            continue
        step = float(axis[-1] - axis[0]) / (len(axis) - 1)
        slack = SAME * step + 4 * float(np.finfo(axis.dtype).eps) * float(np.abs(axis).max())
        if spacing is not None and abs(triple("spacing", spacing)[number] - step) > slack:
            raise ValueError(
                f"spacing {spacing!r} contradicts the coordinates along {order[letter]!r}, which are {step:g} apart: leave one out"
            )
        if origin is not None and abs(triple("origin", origin)[number] - float(axis[0])) > slack:
            raise ValueError(
                f"origin {origin!r} contradicts the coordinates along {order[letter]!r}, which begin at {float(axis[0]):g}: "
                "leave one out"
            )
