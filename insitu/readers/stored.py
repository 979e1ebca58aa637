"""An ensemble stored in one HDF5, netCDF or Zarr file: every member's field, its parameters and its split.

Our own layout (axes as numpy sees them; M members, P parameters) is

    field        (M, z, y, x), any real type; the array may have another name, given by the caller, and there may be several
    params       (M, P)
    split        (M,) strings "train", "validation" or "test"; optional: without it all members train
    attributes   names (P,); lower, upper (P,): the bounds; optional units (P,)
                 spacing, origin (3,): x, y, z, world units; origin is the place of the first value
                 field: what the values are; time: of the simulation (both optional)

Others are found by their structure (`layout`).  Coordinates of the axes go before the attributes spacing and origin; bounds that
no attribute states are those of the members.

Cell values with `origin` at the first cell's centre become samples at the cell centres.  The rendered box then ends half a cell
inside the simulated one, and no value is averaged.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from catalogs.vocabulary.parameters import SPLITS, ParameterSpace
from catalogs.vocabulary.scene import PlannedMember
from catalogs.vocabulary.words import joined_names
from insitu.fields.field import Field
from insitu.fields.location import FieldLocation
from insitu.readers.arrays import HDF5, NETCDF, Arrays, LabelledArray, StoredArray
from insitu.readers.attributes import TIME, as_text, attributes_about, bounds_about, splits_of
from insitu.readers.identity import contents
from insitu.readers.layout import EnsembleLayout, FileMapping, find_layout
from insitu.readers.placement import axis_names, place_of, placed_field
from insitu.readers.tables import Bounds, bounded_space
from insitu.readers.time_axes import open_in_time
from render.xarray_fields import axis_order


@dataclass(frozen=True, eq=False)
class StoredEnsemble:
    """The ensemble in a file; fields are read one member at a time.  A source of fields for `run_ensemble`.

    Attributes
    ----------
    shape : (nz, ny, nx) of every member and field.
    space : the parameters; `parameters` are the members' (M, P) in its order.
    splits : (M,).
    spacing, origin : of the samples, (x, y, z), world units; None where the axes have coordinates.
    contents : size and digest of the file (see `insitu.readers.identity`).
    """

    path: Path
    layout: EnsembleLayout = field(repr=False)
    mapped: FileMapping = field(repr=False)
    shape: tuple[int, int, int]
    space: ParameterSpace
    parameters: tuple[tuple[float, ...], ...]
    splits: tuple[str, ...]
    spacing: tuple[float, ...] | None
    origin: tuple[float, ...] | None
    field_name: str
    contents: Mapping[str, Any] = field(repr=False)
    placement: Mapping[str, Any] = field(repr=False)
    expensive: ClassVar[bool] = False
    notes: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        mapped: FileMapping = FileMapping(),  # noqa: B008 - frozen
        *,
        spacing: Sequence[float] | None = None,
        origin: Sequence[float] | None = None,
        bounds: Bounds | None = None,
    ) -> StoredEnsemble:
        """Read the description of an ensemble; its fields stay on disk.

        Parameters
        ----------
        mapped : where things are in the file; what is left out is found.
        spacing, origin : (x, y, z), world units, where the file does not say.
        bounds : (low, high) of some parameters by name, instead of the file's or its members'.

        Raises FileNotFoundError, or ValueError naming the file and what is missing or wrong in it.
        """
        path = Path(path)
        with open_in_time(path) as arrays:
            try:
                return _described(cls, arrays, path, mapped, spacing, origin, bounds or {})
            except ValueError as error:
                raise ValueError(f"{path}: {error}") from None

    def __len__(self) -> int:
        return len(self.parameters)

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        counts = ", ".join(f"{self.splits.count(s)} {s}" for s in SPLITS if s in self.splits)
        return (
            f"StoredEnsemble {self.path.name}: {len(self)} members ({counts}) of {self.field_name}, {nx} x {ny} x {nz}"
        )

    def __str__(self) -> str:
        return f"{self!r}\n  {self.space}"

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the arrays that hold the fields, at least one."""
        return self.layout.fields

    def members(self, validation: int = 0, seed: int = 0) -> tuple[PlannedMember, ...]:
        """All members, named by their place in the file; `validation` of the training ones, drawn by `seed`.

        Of those with the same parameters the last, which a run that was restarted wrote again.
        """
        names, lasts = self.space.names, {row: i for i, row in enumerate(self.parameters)}
        planned = [
            PlannedMember(f"member-{i:04d}", dict(zip(names, row, strict=True)), split)
            for i, (row, split) in enumerate(zip(self.parameters, self.splits, strict=True))
            if lasts[row] == i
        ]
        return with_validation(planned, validation, seed)

    @property
    def identity(self) -> Mapping[str, Any]:
        first, *others = self.fields
        datasets = {"datasets": [first, *others]} if others else {"dataset": first}
        suffix = self.path.suffix.lower()
        kind = "hdf5" if suffix in HDF5 else "netcdf" if suffix in NETCDF else "zarr"
        return {"kind": kind, "file": self.path.name, **datasets, **self.placement, "contents": dict(self.contents)}

    def record(self, member: PlannedMember) -> Mapping[str, Any]:
        """The record kept with a member: the same for all, since they share the file."""
        return self.identity

    def is_changed(self, member: PlannedMember, before: Mapping[str, Any]) -> bool:
        """True if the file holds something else than when `before` was `identity`."""
        return dict(before.get("contents") or self.contents) != dict(self.contents)

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> dict[str, Field | LabelledArray]:
        """The fields of a member that `members` named."""
        return self.read(int(member.name.rsplit("-", 1)[1]))

    def read(self, index: int) -> dict[str, Field | LabelledArray]:
        """The fields of one member by name, (z, y, x); IndexError out of range, ValueError on damaged data."""
        if not 0 <= index < len(self):
            raise IndexError(f"{self.path} has members 0 to {len(self) - 1}, not {index}")
        with open_in_time(self.path) as arrays:
            try:
                return {name: self._field(arrays, name, index) for name in self.fields}
            except (KeyError, ValueError) as error:
                raise ValueError(f"{self.path}: member {index}: {error}") from None

    def _field(self, arrays: Arrays, name: str, index: int) -> Field | LabelledArray:
        array = self.layout.array(arrays, name, index)
        location = FieldLocation(self.spacing, self.origin, dims=self.mapped.dims)
        called = array.stem if len(self.fields) > 1 else self.field_name
        return placed_field(arrays, array, self.layout.places[index].index, location, called)


def with_validation(members: Sequence[PlannedMember], count: int, seed: int) -> tuple[PlannedMember, ...]:
    """The members, `count` of the training ones, drawn by `seed`, set aside for validation."""
    training = [i for i, member in enumerate(members) if member.split == "train"]
    if not 0 <= count < max(1, len(training)):
        raise ValueError(f"{count} validation members cannot be drawn from {len(training)} training ones")
    chosen = set(np.random.default_rng(seed).choice(training, count, replace=False).tolist()) if count else set()
    return tuple(replace(m, split="validation") if i in chosen else m for i, m in enumerate(members))


def _described(
    kind: type[StoredEnsemble],
    arrays: Arrays,
    path: Path,
    mapped: FileMapping,
    spacing: Sequence[float] | None,
    origin: Sequence[float] | None,
    bounds: Bounds,
) -> StoredEnsemble:
    if len(set(mapped.fields)) != len(mapped.fields):
        raise ValueError(f"the fields are arrays of the file, each once, got {joined_names(mapped.fields)}")
    layout = find_layout(arrays, mapped)
    fields = [layout.array(arrays, name) for name in layout.fields]
    shapes = {a.name: a.shape[-3:] for a in fields}
    if len(set(shapes.values())) > 1:
        raise ValueError(
            f"the fields of an ensemble have one shape, got {shapes}: render each into a catalog of its own"
        )
    if not np.isfinite(layout.values).all():
        first = int(np.argwhere(~np.isfinite(layout.values))[0, 0])
        raise ValueError(f"parameters must be finite, those of member {first} are not")
    array, names = fields[0], axis_names(arrays, fields[0])[-3:]
    along = {name: arrays.coordinate(array, name) for name in names}
    order = axis_order(names, mapped.dims, {n: a.attrs for n, a in along.items() if a is not None})
    sizes = dict(zip(names, array.shape[-3:], strict=True))
    about = attributes_about(arrays, array)
    steps, starts = place_of(arrays, array, names, FieldLocation(spacing, origin, dims=mapped.dims))
    space = _space(arrays, layout, fields[0], bounds)
    _check_distinct(path, layout)
    return kind(
        path=path,
        layout=replace(layout, columns=None),
        mapped=mapped,
        shape=(sizes[order["z"]], sizes[order["y"]], sizes[order["x"]]),
        space=space,
        parameters=tuple(tuple(row) for row in layout.values.tolist()),
        splits=splits_of(arrays, mapped.split, len(layout.places)) or ("train",) * len(layout.places),
        spacing=None if steps is None else tuple(steps),
        origin=None if starts is None else tuple(starts),
        field_name=_field_name(about, fields),
        contents={k: v for k, v in contents(path).items() if k != "modified"},
        placement={k: list(v) for k, v in {"spacing": spacing, "origin": origin, "dims": mapped.dims}.items() if v},
    )


def _check_distinct(path: Path, layout: EnsembleLayout) -> None:
    """Warn of times that stand twice; raises ValueError where other members have the same parameters."""
    unique, counts = np.unique(layout.values, axis=0, return_counts=True)
    if len(unique) == len(layout.values):
        return
    says = ", ".join(f"{n} {v:g}" for n, v in zip(layout.names, unique[counts > 1][0], strict=True))
    if not any(TIME.fullmatch(name) for name in layout.names):
        raise ValueError(f"several members have the parameters {says}: members must differ, --parameters names in what")
    count = len(layout.values) - len(unique)
    warnings.warn(f"{count} states stand twice in a file, the later one is taken: {says} in {path}", stacklevel=5)


def _field_name(about: Mapping[str, Any], fields: Sequence[StoredArray]) -> str:
    if len(fields) > 1:
        return ", ".join(a.name for a in fields)
    return as_text(about["field"]) if isinstance(about.get("field"), str | bytes) else fields[0].stem


def _space(arrays: Arrays, layout: EnsembleLayout, field: StoredArray, bounds: Bounds) -> ParameterSpace:
    """The parameters, their bounds as given, else as attributes say, else as the members have them."""
    names, count = layout.names, layout.values.shape[1]
    if len(names) != count or len(layout.units) not in (0, count):
        raise ValueError(
            f"the names of {count} parameters are asked for, got {joined_names(names)} with units {joined_names(layout.units)}"
        )
    stated = bounds_about(arrays, layout.columns, field, count)
    return bounded_space(names, layout.values, layout.units, bounds, stated)
