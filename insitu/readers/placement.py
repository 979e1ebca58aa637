"""The place of an array's values: by the coordinates of its axes, else by attributes, else as the user says."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from insitu.fields.field import Field
from insitu.fields.location import FieldLocation
from insitu.readers.arrays import Arrays, LabelledArray, StoredArray
from insitu.readers.attributes import as_text, asking, attributes_about
from render.coordinates import AXES
from render.xarray_fields import along_axis, axis_order, placed

SPACINGS = ("spacing", "grid_spacing", "voxel_size", "cell_size", "delta")
ORDERS = ("axes", "dims", "dimensions", "axis_order", "order")


def placed_field(
    arrays: Arrays,
    array: StoredArray,
    index: tuple[int, ...] = (),
    location: FieldLocation = FieldLocation(),  # noqa: B008 - frozen
    name: str = "",
) -> Field | LabelledArray:
    """The values at indices of the first axes of `array`, (z, y, x), as a field called `name`, by default as the array.

    Raises ValueError where the axes do not say what they are, or the file not how far apart its values are.
    """
    names = axis_names(arrays, array)
    labelled = arrays.labelled(array, index, names)
    if len(labelled.shape) > 3:  # axes of one value, which `placed` drops
        names = tuple(n for n, size in zip(names, array.shape, strict=True) if size != 1)
    place = place_of(arrays, array, names[-3:], location)
    grid = placed(labelled, location.dims, *place)
    called, about = name or array.stem, attributes_about(arrays, array)
    time = float(about["time"]) if isinstance(about.get("time"), int | float | np.number) else None
    if grid.axes is None:
        steps, starts = place[0] or (1.0, 1.0, 1.0), place[1] or (0.0, 0.0, 0.0)
        return Field(grid.values, steps, starts, called, grid.unit, time)
    coords = dict(zip(AXES, grid.axes, strict=True))
    return LabelledArray(grid.values, ("z", "y", "x"), coords, called, array.attrs, time, grid.notes)


def place_of(arrays: Arrays, array: StoredArray, names: Sequence[str], location: FieldLocation) -> tuple[Any, Any]:
    """(spacing, origin) of the axes called `names`, (x, y, z), world units; as given, maybe None, where all have coordinates.

    Of axes without coordinates they are as given, else as attributes say.
    """
    along = {name: arrays.coordinate(array, name) for name in names}
    spacing, origin = location.spacing, location.origin
    order = axis_order(names, location.dims, {n: a.attrs for n, a in along.items() if a is not None})
    if all(along[order[letter]] is not None for letter in AXES):
        return spacing, origin
    about = attributes_about(arrays, array)
    steps, starts = spacing or _triple(about, SPACINGS) or _steps(about), origin or _triple(about, ("origin",))
    if steps is None:
        raise asking(arrays, ["--spacing, the distances between values along x, y and z (attribute 'spacing')"])
    return _filled(steps, starts or (0.0, 0.0, 0.0), {letter: along[order[letter]] for letter in AXES})


def axis_names(arrays: Arrays, array: StoredArray) -> tuple[str, ...]:
    """Names of all axes: their own, else those that an attribute lists ("member,z,y,x"), else z, y, x for the last three."""
    names = stated_axes(arrays, array)
    if all(array.dims[-3:]) or sorted(name.lower() for name in names[-3:]) == sorted(AXES):
        return (*array.dims[:-3], *names[-3:])
    return (*array.dims[:-3], "z", "y", "x")


def stated_axes(arrays: Arrays, array: StoredArray) -> tuple[str, ...]:
    """Names of all axes: their own, else those that an attribute lists, else ""."""
    if all(array.dims[-3:]):
        return array.dims
    about = attributes_about(arrays, array)
    for key in ORDERS:
        words = re.findall(r"\w+", ",".join(map(as_text, np.atleast_1d(about.get(key, "")))))
        if len(words) >= len(array.shape):
            return tuple(words[: len(array.shape)])
        if sorted(w.lower() for w in words[-3:]) == sorted(AXES):
            return (*array.dims[:-3], *words[-3:])
    return array.dims


def _filled(
    spacing: Sequence[float], origin: Sequence[float], along: Mapping[str, StoredArray | None]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Spacing and origin, those of an axis with coordinates by these."""
    steps, starts = list(spacing), list(origin)
    for number, (letter, coordinate) in enumerate(along.items()):
        if coordinate is not None and coordinate.shape[0] > 1:
            values = along_axis(coordinate.read(), coordinate.stem, coordinate.shape[0], letter, coordinate.attrs)
            assert values is not None
            if letter != "z" or along["x"] is not None or along["y"] is not None:  # else it may be of another unit
                steps[number] = abs(float(values[-1]) - float(values[0])) / (len(values) - 1)
            starts[number] = float(min(values[0], values[-1]))
    return tuple(steps), tuple(starts)


def _triple(about: Mapping[str, Any], names: Sequence[str]) -> tuple[float, ...] | None:
    for name in names:
        values = np.asarray(about.get(name, ()))
        if values.dtype.kind in "fiu" and values.size in (1, 3):
            if not np.isfinite(values).all():
                raise ValueError(f"attribute {name!r} must hold finite numbers, got {values}")
            return tuple(float(v) for v in np.broadcast_to(values.ravel(), 3))
    return None


def _steps(about: Mapping[str, Any]) -> tuple[float, ...] | None:
    spacings = [np.asarray(about.get(f"d{letter}", ())) for letter in AXES]
    if all(v.size == 1 and v.dtype.kind in "fiu" for v in spacings):
        return tuple(float(v.ravel()[0]) for v in spacings)
    return None
