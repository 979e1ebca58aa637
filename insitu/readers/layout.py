"""The layout of an ensemble in one file: the arrays of its fields, its members' parameters and their names.

Three layouts are found by their structure, whatever things are called:

    one array (member, z, y, x) beside parameters (member, parameter), or one array (member,) for each of them
    one array (a, b, ..., z, y, x) whose first axes have coordinates: these are the parameters; along an axis that only numbers
        members, such as xarray's (member, time, z, y, x), they are the other arrays (member,)
    one array (z, y, x) a member, or one group of them a member, with the parameters as attributes or single values
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import joined_names
from insitu.readers.arrays import Arrays, StoredArray
from insitu.readers.attributes import (
    SPLIT,
    as_text,
    asking,
    auxiliaries,
    column_names,
    column_units,
    is_time,
    numbers_of,
    table_of,
    wanted_array,
)
from render.coordinates import AXES, letter_of

FIELD = "field"  # what our own layout calls its fields, parameters and splits
TABLES = ("params", "parameters", "param", "theta", "inputs", "design", "samples")
NUMBERING = {"index", "id", "idx", "member", "members", "sample", "run", "realization", "case", "seed", "step", "steps"}
NO_PARAMETERS = {
    "spacing",
    "origin",
    "dx",
    "dy",
    "dz",
    "time_step",
    "scale_factor",
    "add_offset",
    "_FillValue",
    "missing_value",
    "valid_min",
    "valid_max",
}


@dataclass(frozen=True)
class FileMapping:
    """The user's description of a file; what is left empty is found.

    Attributes
    ----------
    fields, parameters : names of arrays in the file (or, of parameters, of attributes).
    names, units : of the columns of one array of parameters.
    split : name of the array of splits.
    dims : what the last three axes are, in the arrays' own order.
    """

    fields: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    split: str | None = None
    dims: tuple[str, ...] | None = None


@dataclass(frozen=True)
class MemberPlace:
    """The place of a member's fields: arrays below a group (`prefix` ends with "/", or is an array's name), at an index."""

    prefix: str = ""
    index: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class EnsembleLayout:
    """The arrays of fields, and by member their place and parameters [M, P].

    `units` are "" where unknown; `columns` is the array that holds all parameters, where there is one.
    """

    fields: tuple[str, ...]
    places: tuple[MemberPlace, ...]
    names: tuple[str, ...]
    values: NDArray[np.float64]  # [M, P]
    units: tuple[str, ...] = ()
    columns: StoredArray | None = field(default=None, repr=False)

    def array(self, arrays: Arrays, name: str, member: int = 0) -> StoredArray:
        """The array in which a member's field of this name lies."""
        return arrays.arrays[self.places[member].prefix + (name if not self.is_bare else "")]

    @property
    def is_bare(self) -> bool:
        """True if each member is an array of its own, which bears its name and not a field's."""
        prefix = self.places[0].prefix
        return bool(prefix) and not prefix.endswith("/")


def find_layout(arrays: Arrays, mapped: FileMapping) -> EnsembleLayout:
    """The layout of a file; raises ValueError asking, in one sentence, for what is missing, with a list of what is there."""
    wanted = [match for name in mapped.fields if (match := wanted_array(arrays, name)) is not None]
    if not mapped.fields and FIELD in arrays.arrays:
        wanted = [arrays.arrays[FIELD]]
    for array in wanted:
        if not array.is_real:
            raise ValueError(f"dataset {array.name!r} must hold real numbers, got {array.dtype}")
    if wanted and len(wanted) == max(1, len(mapped.fields)) and all(len(a.shape) >= 4 for a in wanted):
        return _stacked(arrays, mapped, wanted)
    stacked = stacked_fields(arrays)
    if len(stacked) > 1 and not mapped.fields:
        raise asking(arrays, [f"--array, which of {joined_names([a.name for a in stacked])} holds the field"])
    if stacked and not mapped.fields:
        return _stacked(arrays, mapped, stacked)
    layout = _separate(arrays, mapped)
    if layout is None:
        if wanted and len(wanted) == max(1, len(mapped.fields)):
            raise ValueError(
                f"dataset {wanted[0].name!r} must have the axes (member, z, y, x), got shape {wanted[0].shape}; the file "
                f"holds {arrays}"
            )
        lacking = [name for name in mapped.fields if wanted_array(arrays, name) is None]
        wish = joined_names(lacking) if lacking else "(member, z, y, x), nor one (z, y, x) for each member"
        raise ValueError(f"there is no field {wish}; the file holds {arrays}")
    return layout


def stacked_fields(arrays: Arrays) -> list[StoredArray]:
    """The arrays of numbers with more axes than a field has, but those that describe others."""
    aside = auxiliaries(arrays)
    candidates = [a for a in arrays.arrays.values() if a.name not in aside]
    return [a for a in candidates if a.is_real and len(a.shape) >= 4 and min(a.shape[-3:]) >= 2]


# ---- one array for all members ---------------------------------------------------------------------------------------


def _stacked(arrays: Arrays, mapped: FileMapping, fields: Sequence[StoredArray]) -> EnsembleLayout:
    leads = {a.shape[:-3] for a in fields}
    if len(leads) > 1:
        raise ValueError(f"the fields' members must agree, got {', '.join(map(repr, fields))}")
    flat = [a for a in fields if min(a.shape[-3:]) < 2]
    if flat:
        raise ValueError(f"a volume needs at least 2 values along every axis, {flat[0].name!r} is {flat[0].shape}")
    lead = fields[0].shape[:-3]
    places = tuple(MemberPlace(index=index) for index in itertools.product(*map(range, lead)))
    if not places:
        raise ValueError(f"{fields[0]!r} has no members")
    names = tuple(a.name for a in fields)
    if len(lead) == 1:
        columns, single = _columns(arrays, mapped, lead[0], fields[0])
        if columns is not None:
            values, own = table_of(columns)
            titles = tuple(mapped.names) or own or column_names(arrays, columns, values.shape[1], fields)
            units = tuple(mapped.units) or column_units(arrays, columns, values.shape[1], fields)
            return EnsembleLayout(names, places, titles, values, units, columns)
        if single:
            values = np.stack([numbers_of(a) for a in single], axis=1)  # [M, P]
            return EnsembleLayout(names, places, *_renamed(mapped, single), values, _own_units(mapped, single))
    axes = _lead_coordinates(arrays, mapped, fields[0])
    along = [array for axis in axes for array in axis]
    grid = np.indices(lead).reshape(len(lead), -1)  # [axes, M]
    values = np.stack([numbers_of(a)[grid[i]] for i, axis in enumerate(axes) for a in axis], axis=1)  # [M, P]
    return EnsembleLayout(names, places, *_renamed(mapped, along), values, _own_units(mapped, along))


def _columns(
    arrays: Arrays, mapped: FileMapping, count: int, field: StoredArray
) -> tuple[StoredArray | None, list[StoredArray]]:
    """The one array that holds all parameters of `count` members, or the arrays of one each."""
    if mapped.parameters:
        columns = [wanted_array(arrays, name) for name in mapped.parameters]
        lacking = [n for n, a in zip(mapped.parameters, columns, strict=True) if a is None or a.shape[:1] != (count,)]
        if lacking:
            raise ValueError(
                f"--parameters {joined_names(lacking)} are not arrays of {count} members; the file holds {arrays}"
            )
        present = [a for a in columns if a is not None]
        is_table = len(present) == 1 and (len(present[0].shape) == 2 or present[0].dtype.names)
        return (present[0], []) if is_table else (None, present)
    aside = auxiliaries(arrays, but="coordinates")
    candidates = [a for a in arrays.arrays.values() if a.name not in aside and a.name != field.name]
    usual = [a for a in candidates if a.stem in TABLES and (len(a.shape) == 2 or a.dtype.names)]
    if len(usual) == 1 and usual[0].shape[0] != count:
        raise ValueError(
            f"{field.name!r} has {count} members and {usual[0].name!r} {usual[0].shape[0]}: they must agree"
        )
    single = [a for a in candidates if _is_single(a, count) and _along_members(a, field)]
    times = [a for a in single if is_time(a)]
    times = [a for a in times if a.dims == (a.stem,)] or times
    if times and not usual and field.dims[0]:  # what else goes with time is an outcome
        return None, times[:1]
    tables = [a for a in candidates if _is_table(a, count) and len({*field.dims[:1], *a.dims[:1]} - {""}) < 2]
    tables = [a for a in tables if a.stem in TABLES] or tables
    if len(tables) == 1:
        return tables[0], []
    if tables:
        raise asking(
            arrays, [f"--parameters, which of {joined_names([a.name for a in tables])} holds the members' parameters"]
        )
    if not single:
        named = field.dims[0] if field.dims else ""
        if not named:
            raise asking(arrays, [f"--parameters, an array ({count}, parameter) or some of ({count},)"])
    return None, single


def _is_table(array: StoredArray, count: int) -> bool:
    if array.dtype.names:
        return array.shape == (count,) and all(array.dtype[n].kind in "fiu" for n in array.dtype.names)
    return len(array.shape) == 2 and array.shape[0] == count and array.dtype.kind in "fiu" and array.shape[1] <= 100


def _is_single(array: StoredArray, count: int) -> bool:
    if array.shape != (count,) or array.dtype.kind not in "fiu" or array.stem.lower() in NUMBERING | {SPLIT}:
        return False
    return len(np.unique(array.read())) > 1 or count == 1


def _along_members(array: StoredArray, field: StoredArray) -> bool:
    """True if the one axis of `array` may be the members', as far as axes have names."""
    named, other = (field.dims or ("",))[0], (array.dims or ("",))[0]
    if named:
        return other == named
    if other:
        return not any(letter_of(stem, {}) or stem in field.dims[-3:] for stem in (other, array.stem))
    return array.stem not in AXES or array.shape[0] not in field.shape[-3:]  # else it may be a coordinate


def _lead_coordinates(arrays: Arrays, mapped: FileMapping, field: StoredArray) -> list[list[StoredArray]]:
    """The parameters along each of the first axes: its coordinate, or the arrays that say more of a member than its number."""
    coordinates = []
    for number, (dim, size) in enumerate(zip(field.dims, field.shape[:-3], strict=False)):
        named = [a for a in arrays.arrays.values() if dim and a.dims == (dim,) and _is_single(a, size)]
        if named and not mapped.parameters and dim.lower() in NUMBERING:
            coordinates.append(named)
            continue
        along = (
            wanted_array(arrays, mapped.parameters[number])
            if number < len(mapped.parameters)
            else arrays.coordinate(field, dim)
        )
        if along is None or along.shape != (size,):
            raise asking(
                arrays, [f"--parameters, the values along each of the first {len(field.shape) - 3} axes of {field!r}"]
            )
        coordinates.append([along])
    return coordinates


def _renamed(mapped: FileMapping, arrays: Sequence[StoredArray]) -> tuple[tuple[str, ...]]:
    if mapped.names and len(mapped.names) != len(arrays):
        raise ValueError(
            f"--names must name the {len(arrays)} parameters {joined_names([a.name for a in arrays])}, got "
            f"{joined_names(mapped.names)}"
        )
    return (tuple(mapped.names) or tuple(a.stem for a in arrays),)


def _own_units(mapped: FileMapping, arrays: Sequence[StoredArray]) -> tuple[str, ...]:
    return tuple(mapped.units) or tuple(as_text(a.attrs.get("units", a.attrs.get("unit", ""))) for a in arrays)


# ---- an array or a group for each member -----------------------------------------------------------------------------


def _separate(arrays: Arrays, mapped: FileMapping) -> EnsembleLayout | None:
    """The layout where members lie apart; None where no array could be one's field."""
    groups = _volumes_by_group(arrays)
    volumes = [array for arrays_of_group in groups.values() for array in arrays_of_group]
    if len(groups) > 1:
        common = common_fields(arrays)
        fields = tuple(mapped.fields) or tuple(common)
        if not fields or not set(fields) <= set(common):
            return None
        if len(fields) > 1 and not mapped.fields:
            raise asking(arrays, [f"--array, which of {joined_names(fields)} is the field"])
        members = list(groups)
        places = tuple(MemberPlace(f"{group}/") for group in members)
        of = [
            {**arrays.attrs.get(g, {}), **_single_values(arrays, g), **_only(groups[g], fields[0]).attrs}
            for g in members
        ]
    elif len(volumes) > 1:
        chosen = sorted(volumes, key=lambda a: _natural(a.name))
        if mapped.fields:
            return None
        fields, places = ("field",), tuple(MemberPlace(a.name) for a in chosen)
        members, of = [a.name for a in chosen], [dict(a.attrs) for a in chosen]
    else:
        return None
    names, values = _parameters_of(arrays, mapped, members, of)
    return EnsembleLayout(
        fields, places, tuple(mapped.names) or names, values, tuple(mapped.units) or ("",) * len(names)
    )


def _volumes_by_group(arrays: Arrays) -> dict[str, list[StoredArray]]:
    """The arrays that could be fields, by group in the order of their numbers."""
    aside = auxiliaries(arrays)
    groups: dict[str, list[StoredArray]] = {}
    for array in arrays.arrays.values():
        if array.name not in aside and array.is_real and len(array.shape) == 3 and min(array.shape) >= 2:
            groups.setdefault(array.group, []).append(array)
    return {group: groups[group] for group in sorted(groups, key=_natural)}


def common_fields(arrays: Arrays) -> dict[str, list[StoredArray]]:
    """By name in their groups the fields that all of several groups have, one of each; none where the fields lie in one group."""
    groups = _volumes_by_group(arrays)
    stems = [{array.stem: array for array in by_stem} for by_stem in groups.values()]
    names = [name for name in stems[0] if all(name in by_stem for by_stem in stems)] if len(stems) > 1 else []
    return {name: [by_stem[name] for by_stem in stems] for name in names}


def _only(candidates: Sequence[StoredArray], stem: str) -> StoredArray:
    return next(a for a in candidates if a.stem == stem)


def _single_values(arrays: Arrays, group: str) -> dict[str, Any]:
    """The single numbers that a group holds as arrays."""
    single = [a for a in arrays.arrays.values() if a.group == group and np.prod(a.shape) == 1 and a.dtype.kind in "fiu"]
    return {a.stem: a.read().ravel()[0] for a in single}


def _parameters_of(
    arrays: Arrays, mapped: FileMapping, members: Sequence[str], of: Sequence[Mapping[str, Any]]
) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """The attributes that are numbers of every member and differ between some; else the rows of a table."""
    numbers = [{k: v for k, v in attrs.items() if _is_number(v)} for attrs in of]
    common = [k for k in numbers[0] if all(k in n for n in numbers)]
    lacking = [name for name in mapped.parameters if name not in common]
    if mapped.parameters and not lacking:
        names = list(mapped.parameters)
    else:
        tables = [
            a
            for a in arrays.arrays.values()
            if _is_table(a, len(members)) and a.name in (mapped.parameters or [a.name])
        ]
        if len(tables) == 1:
            values, own = table_of(tables[0])
            return tuple(mapped.names) or own or column_names(arrays, tables[0], values.shape[1], ()), values
        if lacking:
            raise ValueError(
                f"--parameters {joined_names(lacking)} are not numbers of every member; they have {common or 'none'} in common"
            )
        names = [k for k in common if k not in NO_PARAMETERS and k.lower() not in NUMBERING]
        names = [k for k in names if len({float(np.ravel(n[k])[0]) for n in numbers}) > 1]
    if not names:
        raise asking(
            arrays,
            [
                f"--parameters: the {len(members)} members, such as {members[0]!r}, have the attributes "
                f"{joined_names(sorted(of[0]))}"
            ],
        )
    return tuple(names), np.array([[float(np.ravel(n[k])[0]) for k in names] for n in numbers])


def _is_number(value: Any) -> bool:
    array = np.asarray(value)
    return array.size == 1 and array.dtype.kind in "fiu"


def _natural(name: str) -> list[Any]:
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name) if part]
