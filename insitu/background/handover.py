"""A member's fields as they are handed to another process: checked as far as that costs nothing, and copied once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from catalogs.vocabulary.appearance import Appearance
from insitu.fields.boxes import Box
from insitu.fields.field import Field
from insitu.fields.member_fields import as_fields


def prepared(
    data: Any, appearances: Sequence[Appearance], *, known: Sequence[Appearance], **place: Any
) -> tuple[Any, Mapping[str, Any], Box]:
    """What is to be handed over, the arguments of `as_fields` that are still to be passed with it, and the box that it fills.

    numpy arrays, a bundled `Field`, and mappings of these are handed over as they are, after all was checked that does not depend
    on their values.  Anything else (VTK and pyvista data sets, xarray's, arrays of other libraries or other axes) is made a
    grid here, with the time and the memory that this takes.

    Raises as `as_fields` does; of NaN and infinity in an array that is handed over only its taker knows.
    """
    if place.get("dims") is not None or not _are_plain(data):
        fields = as_fields(data, appearances, known=known, **place)
        return fields, {}, fields.box
    stand_in = as_fields(_corner(data), appearances, known=known, **place)
    grid = next(iter(stand_in.grids.values()))
    low, shape = np.array(grid.origin), np.array(_shapes(data)[0][::-1])
    x, y, z = map(float, low)
    right, back, top = map(float, low + np.array(grid.spacing) * (shape - 1))
    if isinstance(data, Mapping) and "" not in stand_in.grids:
        data = {name: data[name] for name in stand_in.grids}
    return data, place, ((x, y, z), (right, back, top))


def _are_plain(data: Any) -> bool:
    several = data.values() if type(data) is dict else [data]
    held = [value.values if type(value) is Field else value for value in several]
    return bool(held) and all(type(value) is np.ndarray for value in held) and len(set(_shapes(data))) == 1


def _shapes(data: Any) -> list[tuple[int, ...]]:
    several = data.values() if type(data) is dict else [data]
    return [(value.values if type(value) is Field else value).shape for value in several]


def _corner(data: Any) -> Any:
    """Zeros of the same type and number of axes, but at most two along each."""
    if type(data) is dict:
        return {name: _corner(value) for name, value in data.items()}
    if type(data) is Field:
        return replace(data, values=_corner(data.values))
    return np.zeros([min(count, 2) for count in data.shape], data.dtype)
