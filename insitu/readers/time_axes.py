"""Arrays whose time is one of their last three axes, as some write (z, y, x, time), with that axis before the three of space."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from insitu.readers.arrays import Arrays, StoredArray, open_arrays
from insitu.readers.attributes import TIME, as_text, is_time
from insitu.readers.placement import stated_axes
from render.coordinates import letter_of

UNITS = re.compile(
    r"(([munp]|micro|milli|nano)?s(ec(ond)?s?)?|min(ute)?s?|h(ou)?r?s?|d(ay)?s?|y(ea)?r?s?)(\s.*)?", re.I
)


@contextmanager
def open_in_time(path: str | os.PathLike[str]) -> Iterator[Arrays]:
    """As `open_arrays`, with time before the three axes of space."""
    with open_arrays(path) as arrays:
        moved = {a.name: _moved(arrays, a) for a in arrays.arrays.values() if a.is_real and len(a.shape) > 3}
        yield replace(arrays, arrays={**arrays.arrays, **moved})


def _moved(arrays: Arrays, array: StoredArray) -> StoredArray:
    names, count = stated_axes(arrays, array), len(array.shape)
    late = [axis for axis in range(count - 3, count) if _is_time(arrays, array, names[axis])]
    if len(late) != 1 or any(_is_time(arrays, array, name) for name in names[: count - 3]):
        return array
    order = [axis for axis in range(count) if axis != late[0]]
    order.insert(count - 4, late[0])
    shape, dims = tuple(array.shape[axis] for axis in order), tuple(names[axis] for axis in order)
    return replace(array, shape=shape, dims=dims, fetch=_fetch(array, order))


def _is_time(arrays: Arrays, array: StoredArray, name: str) -> bool:
    """True if an axis is time, by its coordinate or its own name."""
    along = arrays.coordinate(array, name)
    if along is None or letter_of(name, {}):
        return TIME.fullmatch(name) is not None
    return is_time(along) or UNITS.fullmatch(as_text(along.attrs.get("units", ""))) is not None


def _fetch(array: StoredArray, order: list[int]) -> Callable[[tuple[int, ...]], Any]:
    """Reads at indices of the first axes in another `order`."""

    def fetch(index: tuple[int, ...]) -> Any:
        chosen: list[Any] = [slice(None)] * len(order)
        for axis, number in zip(order, index, strict=False):
            chosen[axis] = number
        left = order[len(index) :]
        return np.asarray(array.fetch(tuple(chosen))).transpose([sorted(left).index(axis) for axis in left])

    return fetch
