"""An ensemble stored as one HDF5 file: every member's field, its parameters and its split.

Layout (axes as numpy sees them; M members, P parameters):

    field        (M, z, y, x), any real type; the dataset may have another name, given by the caller, and there may be several
    params       (M, P)
    split        (M,) strings "train", "validation" or "test"; optional: without it all members train
    attributes   names (P,); lower, upper (P,): the bounds; optional units (P,)
                 spacing, origin (3,): x, y, z, world units; origin is the place of the first value
                 field: what the values are; time: of the simulation (both optional)

Values are taken where they are given: cell values with `origin` at the first cell's centre become samples at the cell
centres, so that the rendered box ends half a cell inside the simulated one and no value is averaged.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import h5py
import numpy as np
from numpy.typing import NDArray

from catalogs.parameters import SPLITS, Parameter, ParameterSpace
from catalogs.scene import PlannedMember
from insitu.field import Field


@dataclass(frozen=True)
class Hdf5Ensemble:
    """What the file says about its ensemble; fields are read one member at a time.  A source of fields for `run_ensemble`.

    Attributes
    ----------
    datasets : names of the data sets that hold the fields, at least one.
    shape : (nz, ny, nx) of every member and field.
    parameters : (M, P) in the order of `space`.
    splits : (M,).
    """

    path: Path
    datasets: tuple[str, ...]
    shape: tuple[int, int, int]
    space: ParameterSpace
    parameters: tuple[tuple[float, ...], ...]
    splits: tuple[str, ...]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]
    field_name: str
    time: float | None
    expensive: ClassVar[bool] = False

    @classmethod
    def open(cls, path: str | os.PathLike[str], datasets: Sequence[str] = ("field",)) -> Hdf5Ensemble:
        """Read the description of an ensemble; its fields, the data sets of these names, stay on disk.

        Raises FileNotFoundError, or ValueError naming file, dataset or attribute at fault and what it should be.
        """
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path}")
        try:
            with h5py.File(path, "r") as file:
                return _described(file, path, tuple(datasets))
        except OSError as error:
            raise ValueError(f"{path} is not a readable HDF5 file: {error}") from None
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    def __len__(self) -> int:
        return len(self.parameters)

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        counts = ", ".join(f"{self.splits.count(s)} {s}" for s in SPLITS if s in self.splits)
        return f"Hdf5Ensemble {self.path.name}: {len(self)} members ({counts}) of {self.field_name}, {nx} x {ny} x {nz}"

    def __str__(self) -> str:
        return f"{self!r}\n  {', '.join(f'{p.name} [{p.low:g}, {p.high:g}]{p.unit}' for p in self.space.parameters)}"

    def members(self, validation: int = 0, seed: int = 0) -> tuple[PlannedMember, ...]:
        """All members, named by their place in the file; `validation` of the training ones, drawn by `seed`."""
        training = [i for i, split in enumerate(self.splits) if split == "train"]
        if not 0 <= validation < max(1, len(training)):
            raise ValueError(f"{validation} validation members cannot be drawn from {len(training)} training ones")
        rng = np.random.default_rng(seed)
        drawn = set(rng.choice(training, validation, replace=False).tolist()) if validation else set()
        return tuple(
            PlannedMember(
                f"member-{i:04d}",
                dict(zip(self.space.names, row, strict=True)),
                "validation" if i in drawn else split,
            )
            for i, (row, split) in enumerate(zip(self.parameters, self.splits, strict=True))
        )

    @property
    def identity(self) -> Mapping[str, Any]:
        first, *others = self.datasets
        held = {"datasets": [first, *others]} if others else {"dataset": first}
        return {"kind": "hdf5", "file": self.path.name, **held}

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> dict[str, Field]:
        """The fields of a member that `members` named."""
        return self.read(int(member.name.rsplit("-", 1)[1]))

    def read(self, index: int) -> dict[str, Field]:
        """The fields of one member by data set, (z, y, x) float32; IndexError out of range, ValueError on damaged data."""
        if not 0 <= index < len(self):
            raise IndexError(f"{self.path} has members 0 to {len(self) - 1}, not {index}")
        found = {}
        for dataset in self.datasets:
            try:
                with h5py.File(self.path, "r") as file:
                    values = file[dataset].astype(np.float32)[index]
            except (OSError, KeyError) as error:
                raise ValueError(f"{self.path}: member {index} of {dataset!r} cannot be read: {error}") from None
            name = dataset if len(self.datasets) > 1 else self.field_name
            found[dataset] = Field(values, self.spacing, self.origin, name, time=self.time)
        return found


def _described(file: h5py.File, path: Path, datasets: tuple[str, ...]) -> Hdf5Ensemble:
    params = _dataset(file, "params", 2, "(member, parameter)")
    count, width = params.shape
    if not datasets or len(set(datasets)) != len(datasets):
        raise ValueError(f"the fields are data sets of the file, each once, got {list(datasets)}")
    shapes = {name: _field_shape(file, name, count) for name in datasets}
    if len(set(shapes.values())) > 1:
        raise ValueError(
            f"the fields of an ensemble have one shape, got {shapes}: render each into a catalog of its own"
        )
    names = [_text(n) for n in _attribute(file, "names", width)]
    lower, upper = _numbers(file, "lower", width), _numbers(file, "upper", width)
    units = [_text(u) for u in _attribute(file, "units", width)] if "units" in file.attrs else [""] * width
    parameters = params[()].astype(np.float64)  # [M, P]
    if not np.isfinite(parameters).all():
        raise ValueError(f"'params' must be finite, member {int(np.argwhere(~np.isfinite(parameters))[0, 0])} is not")
    return Hdf5Ensemble(
        path=path,
        datasets=datasets,
        shape=shapes[datasets[0]],
        space=ParameterSpace(tuple(Parameter(*p) for p in zip(names, lower, upper, units, strict=True))),
        parameters=tuple(tuple(row) for row in parameters.tolist()),
        splits=_splits(file, count),
        spacing=_triple(file, "spacing"),
        origin=_triple(file, "origin"),
        field_name=", ".join(datasets) if len(datasets) > 1 else _text(file.attrs.get("field", datasets[0])),
        time=float(file.attrs["time"]) if "time" in file.attrs else None,
    )


def _field_shape(file: h5py.File, dataset: str, count: int) -> tuple[int, int, int]:
    """(nz, ny, nx) of a field's data set of `count` members; raises ValueError where it is not one."""
    field = _dataset(file, dataset, 4, "(member, z, y, x)")
    if field.dtype.kind not in "fiu":
        raise ValueError(f"dataset {dataset!r} must hold real numbers, got {field.dtype}")
    if field.shape[0] != count or not count:
        raise ValueError(f"{dataset!r} has {field.shape[0]} members and 'params' {count}: they must agree and be some")
    if min(field.shape[1:]) < 2:
        raise ValueError(f"a volume needs at least 2 values along every axis, {dataset!r} is {field.shape}")
    nz, ny, nx = field.shape[1:]
    return nz, ny, nx


def _dataset(file: h5py.File, name: str, axes: int, meaning: str) -> h5py.Dataset:
    found = file.get(name)
    if not isinstance(found, h5py.Dataset):
        raise ValueError(f"there is no dataset {name!r} {meaning}; the file holds {sorted(file)}")
    if found.ndim != axes:
        raise ValueError(f"dataset {name!r} must have the axes {meaning}, got shape {found.shape}")
    return found


def _attribute(file: h5py.File, name: str, count: int) -> NDArray[Any]:
    if name not in file.attrs:
        raise ValueError(f"the file lacks the attribute {name!r}; it has {sorted(file.attrs)}")
    values = np.atleast_1d(file.attrs[name])
    if values.shape != (count,):
        raise ValueError(f"attribute {name!r} must hold {count} values, got shape {values.shape}")
    return values


def _numbers(file: h5py.File, name: str, count: int) -> list[float]:
    values = _attribute(file, name, count)
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise ValueError(f"attribute {name!r} must hold finite numbers, got {values}")
    return [float(v) for v in values]


def _triple(file: h5py.File, name: str) -> tuple[float, float, float]:
    x, y, z = _numbers(file, name, 3)
    return x, y, z


def _splits(file: h5py.File, count: int) -> tuple[str, ...]:
    if "split" not in file:
        return ("train",) * count
    splits = tuple(_text(s) for s in _dataset(file, "split", 1, "(member,)")[()])
    wrong = sorted(set(splits) - set(SPLITS))
    if len(splits) != count or wrong:
        raise ValueError(f"'split' must hold {count} of {SPLITS}, got {len(splits)} with {wrong or 'no others'}")
    return splits


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
