"""HDF5, netCDF and Zarr files of no special code that hold several states each: runs with all their times in one file."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from insitu.readers.arrays import Arrays, StoredArray, is_store, open_arrays
from insitu.readers.attributes import wanted_array
from insitu.readers.layout import FileMapping, find_layout, stacked_fields
from insitu.readers.reader import Reader, Sampling, StoredState


def records(
    path: Path, sampling: Sampling, fields: Sequence[str] = (), units: dict[str, str] | None = None
) -> list[StoredState]:
    """The states of a file: one for each index of the first axes of `fields`, by default of all that have more than three.

    `units` of what states say are those of the first file; another file's that differ give one warning.
    """
    with open_arrays(path) as arrays:
        held = _fields(arrays, fields)
        if not held:
            return [StoredState()]
        try:
            layout = find_layout(arrays, FileMapping(tuple(array.name for array in held)))
        except ValueError:
            if math.prod(held[0].shape[:-3]) == 1:
                return [StoredState((0,) * (len(held[0].shape) - 3))]
            raise
    known = {} if units is None else units
    for name, unit in zip(layout.names, layout.units, strict=False):
        if known.setdefault(name, unit) != unit and known.setdefault(f"{name} of others", unit) == unit:
            message = (
                f"{path}: {name} is in {unit!r}, in another file in {known[name]!r}: its numbers are taken as they are"
            )
            warnings.warn(message, stacklevel=2)
    return [
        StoredState(place.index, dict(zip(layout.names, map(float, row), strict=True)))
        for place, row in zip(layout.places, layout.values, strict=True)
    ]


def has_states(path: Path, fields: Sequence[str] = ()) -> bool:
    """True if a file holds more than one state of its fields; one that is damaged has none."""
    if not is_store(path):
        return False
    try:
        with open_arrays(path) as arrays:
            return any(math.prod(array.shape[:-3]) > 1 for array in _fields(arrays, fields))
    except (ValueError, OSError):
        return False


def reader_of_fields(fields: Sequence[str]) -> Reader:
    """The reader of the states of these fields, with their units once it has read some."""
    units: dict[str, str] = {}
    return replace(READER, records=lambda path, sampling: records(path, sampling, fields, units), units=units)


def _fields(arrays: Arrays, names: Sequence[str]) -> list[StoredArray]:
    found = [wanted_array(arrays, name) for name in names] if names else stacked_fields(arrays)
    return [array for array in found if array is not None and array.is_real and len(array.shape) > 3]


READER = Reader(
    "store",
    "HDF5, netCDF or Zarr with several times, or other members, each",
    lambda path: False,
    records,
    opens=open_arrays,
)
