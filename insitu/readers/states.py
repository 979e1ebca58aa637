"""Members distinguished by the contents of their files: the states that a code's files hold, each a row of the table."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from catalogs.vocabulary.words import joined_names, shortened
from insitu.readers import stores, vtk_files
from insitu.readers.arrays import is_store, open_arrays
from insitu.readers.attributes import TIME
from insitu.readers.codes import listed_readers, reader_named, reader_of
from insitu.readers.files import is_field_file
from insitu.readers.folders import files_below, is_folder_file
from insitu.readers.reader import Reader, Sampling, StoredState
from insitu.readers.tables import MemberTable, TableRow, distinct

LOOKED_AT = 16  # files, spread over all, that show of which code they are
COUNTERS = {"step", "iteration", "snapshot", "cycle"}  # numbers of states that count what was written, or computed
SAME = 1e-9  # relative deviation at which a number of a table still names the state of a file


def dumps_below(folder: Path, name: str = "") -> list[Path]:
    """The dumps of one code in a folder, or the folder itself where it is one; `name` says of which code.

    Raises ValueError where there are none, or of several codes.
    """
    if is_folder_file(folder):
        return [folder]
    if name:
        reader_named(name)
    by_reader: dict[str, list[Path]] = {}
    for path in files_below(folder, deep=False):
        reader = reader_of(path)
        if reader is not None and name in ("", reader.name):
            by_reader.setdefault(reader.name, []).append(path)
    if len(by_reader) > 1:
        by_reader.pop(vtk_files.READER.name, None)  # files of general formats beside those of a code
    if len(by_reader) > 1:
        raise ValueError(f"{folder} has dumps of several codes, {', '.join(by_reader)}: choose one by --reader")
    if not by_reader:
        raise no_ensemble(str(folder))
    return next(iter(by_reader.values()))


def table_of_files(paths: Sequence[Path]) -> MemberTable:
    """Files that nothing but their contents tells apart; raises FileNotFoundError naming those that are absent."""
    absent = [str(path) for path in paths if not is_field_file(path)]
    if absent:
        raise FileNotFoundError(f"there is no file {shortened(absent, 10)}")
    return MemberTable(tuple(TableRow(path, {}) for path in paths), {})


def no_ensemble(source: str) -> ValueError:
    """The error that says what an ensemble may be."""
    return ValueError(
        f"{source} is not an ensemble: name a table of files (.csv), a pattern of files such as 'run_{{Re}}.vti', one HDF5, netCDF "
        f"or Zarr file, or files or a folder of one code: {listed_readers()}"
    )


def reader_for(paths: Sequence[Path], name: str = "") -> Reader | None:
    """The one reader of some files, of which not all are looked at; raises ValueError where they are of several codes."""
    by_file = {path: reader_of(path, name) for path in _some(paths)}
    readers = {
        reader.name if reader else "": reader for path, reader in by_file.items() if reader or not _is_damaged(path)
    }
    if not readers:
        return None
    if len(readers) > 1:
        raise ValueError(
            f"the files are of several kinds, {joined_names(sorted(readers))}: name one kind at a time, or choose by --reader"
        )
    return next(iter(readers.values()))


def _is_damaged(path: Path) -> bool:
    """True if a file with named arrays can't be opened, so that it does not show of which code it is."""
    if not is_store(path):
        return False
    try:
        with open_arrays(path):
            return False
    except (ValueError, OSError):
        return True


def _some(paths: Sequence[Path]) -> Sequence[Path]:
    return paths[:: max(1, len(paths) // LOOKED_AT)]


def members_of(
    listed: Callable[[bool], MemberTable],
    name: str,
    sampling: Sampling,
    wanted: Sequence[str] = (),
    arrays: Sequence[str] = (),
) -> tuple[MemberTable, str]:
    """The members of files, and the name of the code that wrote them, "" where none did.

    `listed` gives the files with what a table or a pattern says of them: all of it (False), or what the files leave open (True).
    Other arguments are those of `with_states`.
    """
    table = listed(True)
    paths = [row.path for row in table.rows]
    reader = reader_for(paths, name)
    if reader is stores.READER or (reader is None and any(stores.has_states(path, arrays) for path in _some(paths))):
        reader = stores.reader_of_fields(arrays)
    if reader is None:
        return listed(False).only(wanted), ""
    return with_states(table, reader, sampling, wanted, arrays), reader.name


def with_states(
    table: MemberTable, reader: Reader, sampling: Sampling, wanted: Sequence[str] = (), arrays: Sequence[str] = ()
) -> MemberTable:
    """The members of a table, one for each state that its files hold.

    Parameters
    ----------
    reader : how the files are read.
    wanted : the parameters, of the table or that files say; by default those of the table, and of what files say whatever else
        tells members apart.
    arrays : the fields.  States that lack one are left out, which one warning says for all.

    What a row says of a file with several states, and the file says of each another, chooses among these; else the row holds.
    A file that can't be read is in `unread`.  Raises ValueError naming the first of them where none can.
    """
    rows: list[TableRow] = []
    stated: list[Mapping[str, float]] = []
    keys: set[tuple[object, ...]] = set()
    firsts: dict[Path, Path] = {}  # of every file that belongs to another's
    lacking: list[tuple[Path, StoredState]] = []
    repeated: list[str] = []
    unread: dict[Path, tuple[TableRow, str]] = {}
    for row in table.rows:
        try:
            if row.path not in firsts:
                firsts |= _first_files(row.path, reader)
            first = firsts[row.path]
            states = reader.states(first, sampling)
        except (OSError, ValueError) as error:
            unread[row.path] = row, str(error) if str(error).startswith(str(row.path)) else f"{row.path}: {error}"
            continue
        records = _meant(states, first, row.parameters)
        for record in records if COUNTERS & set(wanted) else _last(records, first, repeated):
            key = (first, record.index, *row.parameters.values())
            if record.lacks(arrays):
                lacking.append((first, record))
            elif key not in keys:  # files of one state, such as those of several ranks, may all be named
                keys.add(key)
                rows.append(replace(row, path=first, index=record.index))
                stated.append(record.says)
    if unread and not rows and not lacking:
        raise ValueError(next(reason for _, reason in unread.values()))
    if repeated:
        warnings.warn(
            f"{len(repeated)} states stand twice in a file, the later one is taken: {repeated[0]}", stacklevel=2
        )
    if lacking:
        _warn_of_lacking(lacking, len(rows), arrays)
    chosen = _chosen(rows, stated, wanted)
    complete = [
        replace(row, parameters={name: {**says, **row.parameters}[name] for name in chosen})
        for row, says in zip(rows, stated, strict=True)
    ]
    named = [replace(row, name="") if _is_shared(row, complete) else row for row in complete]
    return MemberTable(distinct(named), {**reader.units, **table.units}, tuple(unread.values()))


def states_of(
    row: TableRow, name: str, sampling: Sampling, wanted: Sequence[str], arrays: Sequence[str] = ()
) -> list[TableRow]:
    """The members that a file holds, with the parameters `wanted`; `name` says of which code it is, if that can't be seen.

    Raises ValueError where it says too little, or can't be read yet.
    """
    reader = reader_of(row.path, name)
    if reader is stores.READER or (reader is None and not set(wanted) <= set(row.parameters) and is_store(row.path)):
        reader = stores.reader_of_fields(arrays)
    if reader is not None:
        return list(with_states(MemberTable((row,), {}), reader, sampling, wanted, arrays).rows)
    lacking = [parameter for parameter in wanted if parameter not in row.parameters]
    if lacking:
        raise ValueError(
            f"{row.path}: its path does not say {joined_names(lacking)}, and it is of no code that is known: {listed_readers()}"
        )
    return [row]


def files_beside(path: Path, name: str, sampling: Sampling) -> tuple[Path, ...]:
    """Files that belong to a file besides itself: those of other ranks, and that of the mesh."""
    reader = reader_of(path, name)
    parts = () if reader is None else tuple(part for part in reader.files(path) if part != path)
    return parts if sampling.mesh is None else (*parts, sampling.mesh)


def _first_files(path: Path, reader: Reader) -> dict[Path, Path]:
    """The file that stands for all that belong to one, by each of these."""
    with reader.reading(path):
        parts = reader.files(path)
    return dict.fromkeys([path, *parts], parts[0] if parts else path)


def _meant(states: list[StoredState], path: Path, parameters: Mapping[str, float]) -> list[StoredState]:
    """Of the states of a file those that a row means."""
    if len(states) == 1:
        return states
    telling = [name for name in parameters if len({record.says.get(name) for record in states}) > 1]
    meant = [record for record in states if all(_is_same(record.says.get(name), parameters[name]) for name in telling)]
    if not meant:
        raise ValueError(
            f"{path}: none of its {len(states)} states has {dict(parameters)}; the first says {dict(states[0].says)}"
        )
    return meant


def _last(records: Sequence[StoredState], path: Path, repeated: list[str]) -> list[StoredState]:
    """The states of a file, of those that only a counter tells apart the last: a run that was restarted wrote them again.

    The others are added to `repeated`, in words.
    """
    names = {name for record in records for name in record.says if name not in COUNTERS}
    names = {name for name in names if len({record.says.get(name) for record in records}) > 1}
    if not any(TIME.fullmatch(name) or name == "redshift" for name in names):
        return list(records)
    latest: dict[object, StoredState] = {}
    for record in records:
        numbers = {name: value for name, value in record.says.items() if name in names}
        key = tuple(numbers.items())
        if key in latest:
            repeated.append(f"{', '.join(f'{name} {value:g}' for name, value in numbers.items())} in {path}")
        latest[key] = record
    return list(latest.values())


def _is_same(said: float | None, value: float) -> bool:
    return said is None or math.isclose(said, value, rel_tol=SAME)


def _warn_of_lacking(lacking: Sequence[tuple[Path, StoredState]], others: int, arrays: Sequence[str]) -> None:
    """Warn of the states that lack an array; raises ValueError where all do."""
    path, first = lacking[0]
    what, count = " and ".join(arrays) or "a field", len(lacking)
    if not others:
        names = sorted({name for _, state in lacking for name in state.arrays or ()})
        raise ValueError(f"{path}: no state has {what}; they have {', '.join(names) or 'no field'}")
    place = f"the first is {list(first.index)} of {path}"
    warnings.warn(f"{count} of {count + others} states lack {what} and are left out: {place}", stacklevel=2)


def _chosen(rows: Sequence[TableRow], stated: Sequence[Mapping[str, float]], wanted: Sequence[str]) -> tuple[str, ...]:
    """The names of the parameters."""
    own = tuple(rows[0].parameters)
    common = [name for name in stated[0] if name not in own and all(name in says for says in stated)]
    if wanted:
        unknown = [name for name in wanted if name not in (*own, *common)]
        if unknown:
            raise ValueError(f"--parameters {joined_names(unknown)} are none of {joined_names([*own, *common])}")
        return tuple(wanted)
    columns = [[row.parameters[name] for row in rows] for name in own]
    chosen = list(own)
    for name in common:
        column = [says[name] for says in stated]
        # Redshift, time and step of one run tell its dumps apart equally well: one of them will do.
        if len(set(column)) > 1 and not any(_is_as_telling(column, other) for other in columns):
            chosen.append(name)
            columns.append(column)
    if not chosen:
        said = ", ".join(f"{name} {stated[0][name]:g}" for name in common) or "nothing"
        raise ValueError(
            f"nothing tells the members apart: the files say {said}, the same in all {len(rows)}; name parameters in a table or "
            "a pattern, or choose one that files say by --parameters and give its --bounds"
        )
    return tuple(chosen)


def _is_as_telling(column: Sequence[float], other: Sequence[float]) -> bool:
    """True if two columns are equal in the same rows."""
    return len(set(zip(column, other, strict=True))) == len(set(column)) == len(set(other))


def _is_shared(row: TableRow, rows: Sequence[TableRow]) -> bool:
    """True if several states have the name that their file has in a table."""
    return bool(row.name) and sum(other.name == row.name for other in rows) > 1
