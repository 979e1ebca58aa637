"""An ensemble whose members lie in a file each: read one at a time, by the worker that renders it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from catalogs.store.missing import MissingMember, missing_members, no_longer_missing, report_missing
from catalogs.store.plan import name_problem
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.scene import PlannedMember
from catalogs.vocabulary.words import joined_names, plural
from insitu.fields.location import FieldLocation
from insitu.members.notes import NO_SPACING
from insitu.members.request import member_name
from insitu.readers.codes import reader_of
from insitu.readers.files import read_data
from insitu.readers.identity import contents, is_changed, stamp
from insitu.readers.reader import Sampling
from insitu.readers.states import files_beside
from insitu.readers.tables import Bounds, MemberTable, TableRow, bounded_space

UNREAD = "its states can't be read"


def name_of_file(path: Path, parameters: Mapping[str, float], name: str) -> str:
    """The name under which a file of unknown states is missing: the table's, that of its parameters, or its own."""
    return name or (member_name(parameters) if parameters else path.stem)


@dataclass(frozen=True, eq=False)
class FileEnsemble:
    """Members with files of their own.  A source of fields for `run_ensemble`.

    Attributes
    ----------
    rows : by the member's name.
    space : the parameters.
    arrays : which arrays of the files are the fields; () where each file holds one, or appearances name them.
    location, reader, sampling : as in `insitu.readers.files.read_data`.
    unread : files of which not even the states could be read; each stands for all its members.
    """

    rows: Mapping[str, TableRow] = field(repr=False)
    space: ParameterSpace
    arrays: tuple[str, ...] = ()
    location: FieldLocation = FieldLocation()  # noqa: RUF009 - frozen
    reader: str = ""
    sampling: Sampling = Sampling()  # noqa: RUF009 - frozen
    unread: tuple[MissingMember, ...] = field(default=(), repr=False)
    expensive: ClassVar[bool] = False

    @classmethod
    def of(
        cls, table: MemberTable, *, bounds: Bounds | None = None, units: Sequence[str] = (), **how: Any
    ) -> FileEnsemble:
        """The ensemble of a table.

        Parameters
        ----------
        bounds : (low, high) of some parameters by name, by default from the smallest to the largest in the table.
        units : of the parameters, by default as the table says.
        how : the other attributes.

        Raises ValueError naming a parameter without bounds, or a name that no member can have.
        """
        rows: dict[str, TableRow] = {}
        for row in table.rows:
            name = row.name or member_name(row.parameters)
            if rows.setdefault(name, row) is not row:
                raise ValueError(f"{rows[name].path} and {row.path} would both be called {name}: give each a name")
            if problem := name_problem(name):
                raise ValueError(f"{row.path}: {problem}")
        names = table.names
        if units and len(units) != len(names):
            raise ValueError(
                f"--units must be of the {len(names)} parameters {joined_names(names)}, got {joined_names(units)}"
            )
        first = table.rows[0].parameters
        of_unread = [{**first, **row.parameters} for row, _ in table.unread]  # whose members must be in bounds, too
        values = np.array(
            [[said[n] for n in names] for said in (*(r.parameters for r in table.rows), *of_unread)]
        )  # [M, P]
        units = units or [table.units.get(name, "") for name in names]
        unread = tuple(
            MissingMember(name_of_file(row.path, row.parameters, row.name), row.parameters, f"{UNREAD}: {reason}")
            for row, reason in table.unread
        )
        return cls(rows, bounded_space(names, values, units, bounds or {}), unread=unread, **how)

    def __len__(self) -> int:
        return len(self.rows)

    def report_unread(self, catalog: Path) -> dict[str, str]:
        """Record in a catalog the files that could not be read, and forget those that now can be; returns the reasons by name."""
        reasons = {missing.name: missing.reason for missing in self.unread}
        with suppress(OSError):  # a disk that refuses has no say
            for missing in missing_members(catalog):
                if missing.reason.startswith(UNREAD) and missing.name not in reasons and self._has_file(missing):
                    no_longer_missing(catalog, missing.name)
            for missing in self.unread:
                report_missing(catalog, missing.name, missing.parameters, missing.reason)
        return reasons

    def _has_file(self, missing: MissingMember) -> bool:
        """True if some member is of the file that was reported."""
        return any(
            missing.name == name_of_file(row.path, {n: row.parameters.get(n, np.nan) for n in missing.parameters}, "")
            for row in self.rows.values()
        )

    def __repr__(self) -> str:
        arrays = ", ".join(self.arrays) or "one array"
        count = len({row.path for row in self.rows.values()})
        return f"FileEnsemble: {plural(len(self), 'member')} in {plural(count, 'file')} of {arrays}"

    def __str__(self) -> str:
        return f"{self!r}\n  {self.space}"

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the fields that `field` returns; () where appearances name them."""
        return self.arrays

    @property
    def notes(self) -> tuple[str, ...]:
        """Options that a user may have forgotten."""
        plain = any(row.path.suffix == ".npy" for row in self.rows.values())
        return (NO_SPACING,) if plain and self.location.spacing is None else ()

    @property
    def identity(self) -> Mapping[str, Any]:
        place = self.location
        stated_place = {"spacing": place.spacing, "origin": place.origin, "dims": place.dims}
        stated_place = {key: list(values) for key, values in stated_place.items() if values}  # type: ignore[misc]
        return {"kind": "files", "arrays": list(self.arrays), **stated_place, **self.sampling.identity}

    def members(self, validation: int = 0, seed: int = 0) -> tuple[PlannedMember, ...]:
        """All members; `validation` of the training ones, drawn by `seed`, are set aside."""
        from insitu.readers.stored import with_validation

        planned = [PlannedMember(name, dict(row.parameters), row.split or "train") for name, row in self.rows.items()]
        return with_validation(planned, validation, seed)

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> Any:
        """The contents of the member's file: fields by name, or one data set."""
        row, path = self.rows[member.name], self.rows[member.name].path

        def read(array: str | None) -> Any:
            return read_data(
                path, self.location, array=array, reader=self.reader, index=row.index, sampling=self.sampling
            )

        return {array: read(array) for array in self.arrays} if self.arrays else read(None)

    def record(self, member: PlannedMember) -> Mapping[str, Any]:
        """`identity`, the file, the code that wrote it, the index of the state where it holds several, and what it holds."""
        row = self.rows[member.name]
        code = reader_of(row.path, self.reader)
        place = {"file": os.fspath(row.path), "reader": code and code.name, "index": list(row.index)}
        nonempty = {key: value for key, value in place.items() if value}
        return {**self.identity, **nonempty, "contents": contents(row.path, beside=self.files(row.path))}

    def is_changed(self, member: PlannedMember, before: Mapping[str, Any]) -> bool:
        """True if the member's file holds something else than when `before` was its `record`."""
        path = self.rows[member.name].path
        if "contents" not in before or not Path(path).exists():
            return False
        code, beside = reader_of(path, self.reader), self.files(path)
        if code is not None and code.grows and stamp(path, beside=beside)["size"] > before["contents"].get("size", 0):
            return False  # states were added behind those that it had
        return is_changed(path, before["contents"], beside=beside)

    def files(self, path: Path) -> tuple[Path, ...]:
        """Files that belong to a member besides the one at `path`: those of other ranks, and that of the mesh."""
        return files_beside(path, self.reader, self.sampling)
