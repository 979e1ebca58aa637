"""Arrays whose axes and coordinates have names, such as xarray's, in the order and at the place that a grid has.

Nothing here imports xarray: an array is labelled that has `dims` and `coords`; a data set, `data_vars`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.words import joined_names
from render.coordinates import AXES, METRES, described, letter_of, points_down, unit_of, unwrapped
from render.grids import triple

SAME = 1e-5  # relative deviation of a spacing, or of an origin in spacings, that still agrees with coordinates
# Height over the shorter horizontal side at which axes of different units are drawn as their numbers are, and else.
SLIMMEST, FLATTEST, HEIGHT = 1.0, 0.05, 0.25


@dataclass(frozen=True, eq=False)
class PlacedArray:
    """Values (nz, ny, nx) of any real type, and where they lie.

    Attributes
    ----------
    axes : increasing coordinates along x, y and z, which points up; None where no axis has any.
    name, unit : of the quantity, "" where unknown.
    notes : what the user should know of the place.
    """

    values: NDArray[Any]  # [nz, ny, nx]
    axes: tuple[NDArray[Any], NDArray[Any], NDArray[Any]] | None
    name: str
    unit: str
    notes: tuple[str, ...] = ()


def is_labelled(data: Any) -> bool:
    """True if `data` is one array with named axes."""
    # Not "values": merely to ask for them would load them.
    return all(hasattr(data, name) for name in ("dims", "coords", "shape")) and not is_labelled_set(data)


def is_labelled_set(data: Any) -> bool:
    """True if `data` holds several labelled arrays by name, such as an xarray.Dataset."""
    return hasattr(data, "data_vars") and hasattr(data, "dims")


def chosen(data: Any, array: str | None) -> Any:
    """The array of a labelled set that is asked for, or the only one with three axes; raises ValueError listing them."""
    names = [str(name) for name in data.data_vars]
    if array is not None:
        if array not in names:
            raise ValueError(f"no array {array!r} in the {type(data).__name__}: it has {names or 'none'}")
        return data[array]
    variables = [data[name] for name in [*data.data_vars, *getattr(data, "coords", ())]]
    aside = {name for one in variables for name in described(getattr(one, "attrs", {}))}
    volumes = [name for name in names if name not in aside and _extents(data[name]) >= 3]
    if len(volumes) != 1:
        raise ValueError(f"name the array to render: the {type(data).__name__} has {joined_names(volumes or names)}")
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
    spacing, origin : must agree with the coordinates where there are any.  `spacing` states the distance along z, too, where z is
        measured in another unit than x and y, such as metres beside degrees.

    Axes of one value, such as a time, are dropped.  Depth and pressure are negative heights.  Raises ValueError naming axes that
    do not say what they are, coordinates that neither increase nor decrease, and a spacing or origin that contradicts them.
    """
    names = [str(name) for name in data.dims]
    remaining = [name for name, size in zip(names, data.shape, strict=True) if size != 1] if len(names) > 3 else names
    if len(remaining) != 3:
        raise ValueError(
            f"a field has 3 axes, this array has {names} of {tuple(data.shape)} values: choose one value along those that "
            f"are not in space, such as .isel({names[0] if names else 'time'}=0)"
        )
    coordinates = {name: data.coords[name] for name in names if name in data.coords}
    about = {name: getattr(coordinates.get(name), "attrs", {}) for name in remaining}
    order = axis_order(remaining, dims, about)
    values = np.asarray(data.values)
    values = values.reshape([n for n, name in zip(values.shape, names, strict=True) if name in remaining])
    values = values.transpose([remaining.index(order[letter]) for letter in "zyx"])
    attributes = getattr(data, "attrs", {})
    before = data.notes if hasattr(type(data), "notes") else ()  # of an xarray it would be one of its own attributes
    labels = str(getattr(data, "name", None) or ""), str(attributes.get("units", ""))
    along = {letter: coordinates.get(order[letter]) for letter in AXES}
    bare = [letter for letter in AXES if along[letter] is None]
    if "z" in bare and points_down(order["z"], {}):
        values = np.flip(values, 0)
    if len(bare) == 3:
        return PlacedArray(values, None, *labels)
    if bare and spacing is None:
        raise ValueError(
            f"the array has coordinates along {joined_names(order[a] for a in AXES if a not in bare)} but none along "
            f"{joined_names(order[letter] for letter in bare)}: give spacing (x, y, z), or the coordinates"
        )
    axes = []
    for number, letter in enumerate(AXES):
        size = values.shape[2 - number]
        axis = along_axis(along[letter], order[letter], size, letter, about[order[letter]])
        if axis is None:
            start = 0.0 if origin is None else triple("origin", origin)[number]
            axis = start + triple("spacing", 1.0 if spacing is None else spacing)[number] * np.arange(size)
        elif axis[0] > axis[-1]:
            axis, values = axis[::-1], np.flip(values, 2 - number)
        axes.append(axis)
    units = [unit_of(order[letter], about[order[letter]]) for letter in AXES]
    factor, notes = _height(axes, order, units, spacing, bare)
    _check_given(axes, order, spacing, origin, 3 if factor is None and bare != ["x", "y"] else 2)
    x, y, z = axes
    return PlacedArray(values, (x, y, z if factor is None else z * factor), *labels, (*before, *notes))


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
        letters = [letter_of(name, (attributes or {}).get(name, {})) for name in names]
        if sorted(letters) != sorted(AXES):
            raise ValueError(
                f"the axes {joined_names(names)} do not say which of them is x, y and z: pass dims, what each "
                f"axis is in the array's own "
                'order, such as dims=("z", "y", "x")'
            )
    return dict(zip(letters, names, strict=True))


def _extents(array: Any) -> int:
    """Along how many axes an array has more than one value; 0 for what holds no numbers."""
    return sum(size > 1 for size in array.shape) if array.dtype.kind in "fiub" else 0


def along_axis(
    coordinate: Any, name: str, size: int, letter: str, attributes: Mapping[str, Any]
) -> NDArray[Any] | None:
    """Coordinates along an axis, upwards along z; raises ValueError where they are not numbers that increase or decrease."""
    if coordinate is None:
        return None
    values = np.asarray(getattr(coordinate, "values", coordinate))
    if values.dtype.kind not in "fiu" or values.shape != (size,):
        raise ValueError(
            f"the coordinates along {name!r} must be {size} real numbers, got {values.dtype} {values.shape}"
        )
    values = unwrapped(values if values.dtype.kind == "f" else values.astype(np.float64), name, attributes)
    steps = np.diff(values)
    if not np.isfinite(values).all() or not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError(f"the coordinates along {name!r} must be finite and increase or decrease strictly")
    return -values if letter == "z" and points_down(name, attributes, values) else values


def _height(
    axes: Sequence[NDArray[Any]],
    order: Mapping[str, str],
    units: Sequence[str],
    spacing: ArrayLike | None,
    bare: Sequence[str],
) -> tuple[float | None, tuple[str, ...]]:
    """The factor of coordinates along z that are of another unit than x and y, and a note on it; None for none.

    Where x and y are `bare` of coordinates, their unit is that of the spacing.  Raises ValueError for two units of length.
    """
    x, y, z = units
    if x != y and x in METRES and y in METRES:
        raise ValueError(f"{order['x']!r} is in {x} and {order['y']!r} in {y}: store their coordinates in one unit")
    if min(map(len, axes)) < 2 or "z" in bare or len(bare) == 1:
        return None, ()
    length, width, height = (float(axis[-1] - axis[0]) for axis in axes)
    shorter = min(length, width)
    is_box = FLATTEST * shorter <= height <= SLIMMEST * shorter
    if is_box if bare else (x != y or x == z or not x or (not z and x != "degrees")):
        return None, ()
    if spacing is not None:
        return triple("spacing", spacing)[2] * (len(axes[2]) - 1) / height, ()
    if x in METRES and z in METRES:
        scaled, why = METRES[z] / METRES[x] * height, f"as in {x}"
    elif is_box:
        return None, ()
    else:
        scaled, why = HEIGHT * shorter, "a quarter of the shorter side"
    steps = ", ".join(f"{side / (len(axis) - 1):.7g}" for side, axis in zip((length, width), axes, strict=False))
    note = (
        f"{order['x']!r} and {order['y']!r} are in {x}, {order['z']!r} is in {z or 'another unit'}: it is drawn {scaled:g} high, "
        f"{why}, in place of {height:g}; for another height give spacing ({steps}, Z)"
    )
    return scaled / height, (note,)


def _check_given(
    axes: Sequence[NDArray[Any]],
    order: Mapping[str, str],
    spacing: ArrayLike | None,
    origin: ArrayLike | None,
    count: int,
) -> None:
    """Raise ValueError where a spacing or origin that was given is not the coordinates' along the first `count` axes."""
    for number, (letter, axis) in enumerate(list(zip(AXES, axes, strict=True))[:count]):
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
