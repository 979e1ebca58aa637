"""HDF5, netCDF and Zarr files of no special code that hold several states each: runs with all their times in one file."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insitu.readers.arrays import Arrays, StoredArray, is_store
from insitu.readers.attributes import attributes_about, wanted_array
from insitu.readers.layout import FileMapping, common_fields, find_layout, stacked_fields
from insitu.readers.placement import SPACINGS, axis_names
from insitu.readers.reader import Reader, Sampling, StoredState
from insitu.readers.time_axes import open_in_time

ENCODING = {"scale_factor", "add_offset", "_FillValue", "missing_value", "valid_range", "valid_min", "valid_max"}


def records(
    path: Path, sampling: Sampling, fields: Sequence[str] = (), units: dict[str, str] | None = None
) -> list[StoredState]:
    """The states of a file: one for each index of the first axes of `fields`, or for each of several groups that have them.

    Without `fields` they are all arrays that have more than three axes, or that all groups have.
    `units` of what states say are those of the first file; another file's that differ give one warning.
    """
    with open_in_time(path) as arrays:
        fields_of_file = _fields(arrays, fields)
        apart = () if fields_of_file else _apart(arrays, fields)
        if not fields_of_file and not apart:
            return [StoredState()]
        try:
            layout = find_layout(
                arrays, FileMapping(tuple(fields) if apart else tuple(array.name for array in fields_of_file))
            )
        except ValueError:
            if fields_of_file and math.prod(fields_of_file[0].shape[:-3]) == 1:
                return [StoredState((0,) * (len(fields_of_file[0].shape) - 3))]
            raise
    unit_by_name = {} if units is None else units
    for name, unit in zip(layout.names, layout.units, strict=False):
        if unit_by_name.setdefault(name, unit) != unit and unit_by_name.setdefault(f"{name} of others", unit) == unit:
            message = f"{path}: {name} is in {unit!r}, in another file in {unit_by_name[name]!r}: its numbers are taken as they are"
            warnings.warn(message, stacklevel=2)
    return [
        StoredState((number,) if apart else place.index, dict(zip(layout.names, map(float, row), strict=True)))
        for number, (place, row) in enumerate(zip(layout.places, layout.values, strict=True))
    ]


def has_states(path: Path, fields: Sequence[str] = ()) -> bool:
    """True if a file holds more than one state of its fields; one that is damaged has none."""
    if not is_store(path):
        return False
    try:
        with open_in_time(path) as arrays:
            fields_of_file = _fields(arrays, fields)
            return any(math.prod(array.shape[:-3]) > 1 for array in fields_of_file) or bool(
                not fields_of_file and _apart(arrays, fields)
            )
    except (ValueError, OSError):
        return False


def reader_of_fields(fields: Sequence[str]) -> Reader:
    """The reader of the states of these fields, with their units once it has read some."""
    units: dict[str, str] = {}
    return replace(READER, records=lambda path, sampling: records(path, sampling, fields, units), units=units)


def _fields(arrays: Arrays, names: Sequence[str]) -> list[StoredArray]:
    candidates = [wanted_array(arrays, name) for name in names] if names else stacked_fields(arrays)
    return [array for array in candidates if array is not None and array.is_real and len(array.shape) > 3]


def _apart(arrays: Arrays, names: Sequence[str]) -> tuple[str, ...]:
    """The fields that each of several groups has, each group a state; () where one of `names` is a single array."""
    common = common_fields(arrays)
    if not set(names) <= set(common) or any(wanted_array(arrays, name) for name in names):
        return ()
    return tuple(common)


@contextmanager
def opens(path: Path) -> Iterator[Arrays]:
    """The arrays of a file; those of several groups as one, (state, z, y, x), in place of the first group's.

    Raises ValueError where groups of one field lie in different places.
    """
    with open_in_time(path) as arrays:
        if stacked_fields(arrays):
            yield arrays
            return
        by_name = dict(arrays.arrays)
        for same in common_fields(arrays).values():
            for array in same:
                del by_name[array.name]
            by_name[same[0].name] = _stacked(arrays, same)
        yield replace(arrays, arrays=by_name)


def _stacked(arrays: Arrays, same: Sequence[StoredArray]) -> StoredArray:
    first = same[0]
    attrs = {key: value for key, value in first.attrs.items() if key not in ENCODING}  # which `read` has undone

    def fetch(index: tuple[int, ...]) -> Any:
        chosen = same[index[0]]
        if (chosen.shape, _place(arrays, chosen)) != (first.shape, _place(arrays, first)):
            raise ValueError(f"{chosen.name} has other axes than {first.name}: save each group as a file")
        return chosen.read(index[1:])

    return StoredArray(first.name, (len(same), *first.shape), first.dtype, ("state", *first.dims), attrs, fetch)


def _place(arrays: Arrays, array: StoredArray) -> tuple[object, ...]:
    """The same for arrays whose values lie in the same places, by coordinates and attributes."""
    along = (arrays.coordinate(array, name) for name in axis_names(arrays, array))
    about = attributes_about(arrays, array)
    stated = (np.asarray(about.get(key, ())).tolist() for key in (*SPACINGS, "origin", "dx", "dy", "dz"))
    return (array.dims, *(None if one is None else one.read().tobytes() for one in along), *map(str, stated))


READER = Reader(
    "store",
    "HDF5, netCDF or Zarr with several times, or other members, each",
    lambda path: False,
    records,
    opens=opens,
)
