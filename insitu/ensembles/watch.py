"""A folder watched while a simulation writes into it: every dump is rendered when it is whole."""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.words import joined_names, shortened
from insitu.ensembles.ensemble import EnsembleResult, available_cores, local_engine, run_ensemble
from insitu.ensembles.files import FileEnsemble
from insitu.ensembles.workers import single_threaded
from insitu.members.beginning import check_new
from insitu.members.failures import warn_caller
from insitu.members.notes import Once
from insitu.members.planning import PlanOptions, is_catalog
from insitu.members.request import Existing, member_name
from insitu.readers.identity import stamp
from insitu.readers.tables import TableRow, matching, pattern_names

INTERVAL = 1.0  # seconds between two looks at the folder


@dataclass(frozen=True)
class WatchOptions:
    """The files to watch, and when one counts as whole.

    Attributes
    ----------
    folder, pattern : the files, as in `insitu.readers.tables`.
    settle : seconds for which size and time of change must stay the same.
    marker : ending of a file that says that the one beside it is whole, such as ".done" for `dump_1.vti.done`; then `settle` does
        not matter.
    patience : seconds for which a file that can't be rendered is tried again.
    until_idle : seconds without anything to do after which the watch ends; None: never.
    parameters : all that a member has; those that the pattern does not name, files must say.
    members : the members in a whole file (a row of the pattern); raises ValueError or OSError where that is not known yet.
    beside : the files that belong to the one at a path; all of them must be whole.
    """

    folder: Path
    pattern: str
    settle: float = 2.0
    marker: str = ""
    patience: float = 60.0
    until_idle: float | None = None
    parameters: tuple[str, ...] = ()
    members: Callable[[TableRow], Sequence[TableRow]] = lambda row: (row,)
    beside: Callable[[Path], Sequence[Path]] = lambda path: ()


@dataclass
class Arrivals:
    """The files of a watch: which are whole, waited for, done or given up.  `look` and `tried` take the time, in seconds."""

    watching: WatchOptions
    done: set[str] = field(default_factory=set)  # names of members that are stored
    failures: dict[str, str] = field(default_factory=dict)  # why the others are not, by name
    _stamps: dict[Path, tuple[dict[str, int], float]] = field(
        default_factory=dict
    )  # stamp, and since when it is the same
    _failed: dict[str, tuple[dict[str, int], float, float]] = field(
        default_factory=dict
    )  # stamp, first and last failure
    _members: dict[Path, tuple[dict[str, int], list[TableRow]]] = field(
        default_factory=dict
    )  # stamp, and the members of a file
    pending: int = 0  # files that may become whole, or be tried again

    def look(self, now: float, wall: float) -> list[TableRow]:
        """The members to render now; `wall` is the time of day, as in files' times of change."""
        ready: dict[str, TableRow] = {}
        self.pending = 0
        for row in matching(self.watching.pattern, self.watching.folder, more_in_files=True):
            if (name := self._name(row)) in self.done or name in ready:
                continue
            try:
                current = stamp(row.path, beside=self.watching.beside(row.path))
            except OSError:
                continue  # gone, or being renamed
            if self._is_given_up(name, current, now):
                continue
            before, since = self._stamps.get(row.path, (None, now))
            if before != current:
                since = now
            self._stamps[row.path] = current, since
            if not self._is_whole(row.path, current, now - since, wall):
                self.pending += 1
            elif self._may_try(name, current, now):
                self._take(row, current, now, ready)
            else:
                self.pending += 1
        return list(ready.values())

    def _take(self, row: TableRow, current: dict[str, int], now: float, ready: dict[str, TableRow]) -> None:
        """Add the members of a whole file that are neither done nor given up to those that are `ready`."""
        before, members = self._members.get(row.path, ({}, []))
        if before != current:
            try:
                members = list(self.watching.members(row))
            except (ValueError, OSError) as error:
                self._note(self._name(row), f"{type(error).__name__}: {error}", current, now)
                self.pending += 1
                return
            self._members[row.path] = current, members
            if self._name(row) not in map(self._name, members):  # it was not known by its members before
                self.failures.pop(self._name(row), None)
        for member in members:
            self._stamps[member.path] = self._stamps[row.path]
            name = self._name(member)
            if name in self.done or name in ready or self._is_given_up(name, current, now):
                continue
            self.pending += 1
            if self._may_try(name, current, now):
                ready[name] = member

    def _name(self, row: TableRow) -> str:
        """The member's name; of a file of which not all parameters are known yet, its path."""
        is_complete = set(row.parameters) >= set(self.watching.parameters)
        return row.name or (member_name(row.parameters) if is_complete else str(row.path))

    def tried(self, rendered: Iterable[str], failures: dict[str, str], rows: dict[str, TableRow], now: float) -> None:
        """Take note of what became of the files that `look` gave."""
        for name in rendered:
            self.done.add(name)
            self.failures.pop(name, None)
            self._failed.pop(name, None)
        for name, why in failures.items():
            self._note(name, why, self._stamps[rows[name].path][0], now)

    def _note(self, name: str, why: str, current: dict[str, int], now: float) -> None:
        before = self._failed.get(name)
        first = before[1] if before is not None and before[0] == current else now
        self._failed[name] = current, first, now
        self.failures[name] = why

    def _is_whole(self, path: Path, current: dict[str, int], unchanged: float, wall: float) -> bool:
        if self.watching.marker:
            return path.with_name(path.name + self.watching.marker).exists()
        settle = self.watching.settle
        return current["size"] > 0 and (unchanged >= settle or wall - current["modified"] / 1e9 >= settle)

    def _is_given_up(self, name: str, current: dict[str, int], now: float) -> bool:
        stamp_then, first, _ = self._failed.get(name, ({}, now, now))
        return stamp_then == current and now - first >= self.watching.patience

    def _may_try(self, name: str, current: dict[str, int], now: float) -> bool:
        """A file that failed is tried again when it has changed, or after as long as it has been failing, at least an interval."""
        stamp_then, first, last = self._failed.get(name, ({}, now, now))
        return stamp_then != current or now - last >= max(INTERVAL, min(last - first, self.watching.patience / 4))


def watch_folder(
    catalog: str | os.PathLike[str],
    watching: WatchOptions,
    ensemble: FileEnsemble,
    options: PlanOptions,
    *,
    arrivals: Arrivals | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    nan: str = "refuse",
    existing: Existing = "error",
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[Any], None] | None = None,
    warn: Callable[[Warning], None] | None = None,
) -> Arrivals:
    """Render the files of a folder as they appear, until nothing is left to do for `until_idle` seconds.

    Parameters
    ----------
    ensemble : how files are read; its rows do not matter.
    existing : as in `run_ensemble`, of members that are stored when the watch begins.
    arrivals : where it is noted what became of the files, for a caller who interrupts the watch.
    say : called with a line about rendered members, and about each failure.

    Other parameters are those of `run_ensemble`, of which each lot of new files is one call; the first makes the catalog.  Files
    that can't be rendered are tried again for as long as `watching` says; their number and reasons are in the result.  Ctrl-C
    (KeyboardInterrupt) ends it and leaves no partial member; the same call then goes on where it stopped.  Raises OSError where the
    disk takes no more, ValueError as `run_ensemble` does.
    """
    arrivals, path, once = arrivals or Arrivals(watching), Path(catalog), Once(warn or warn_caller)
    if not is_catalog(path):
        check_new(path, options)
    reported: dict[str, str] = {}
    idle_since = clock.monotonic()
    with single_threaded(), local_engine(workers or available_cores(), executor) as engine:
        while True:
            now = clock.monotonic()
            rows = _new(path, arrivals, now)
            if rows:
                lot = replace(ensemble, rows=rows)
                how: dict[str, Any] = {
                    "nan": nan,
                    "engine": engine,
                    "progress": progress,
                    "warn": lambda note: once.say("", [note]),
                    "existing": existing,
                }
                _take(arrivals, rows, _rendered(path, lot, options, how), say)
            for name, why in arrivals.failures.items():
                if reported.get(name) != why:
                    say(f"{name} can't be rendered yet: {why}")
            reported = dict(arrivals.failures)
            if arrivals.pending or rows:
                idle_since = clock.monotonic()
            elif watching.until_idle is not None and clock.monotonic() - idle_since >= watching.until_idle:
                return arrivals
            if not rows:
                clock.sleep(min(INTERVAL, max(0.05, watching.settle / 4)))


def _new(path: Path, arrivals: Arrivals, now: float) -> dict[str, TableRow]:
    """The files to render now, by the names of their members; those stored under another name are done."""
    rows = {member_name(row.parameters): row for row in arrivals.look(now, clock.time())}
    if rows and is_catalog(path):
        catalog = Catalog.open(path)
        elsewhere = {name for name, row in rows.items() if catalog.find(row.parameters) not in (None, name)}
        arrivals.tried(elsewhere, {}, rows, now)
        return {name: row for name, row in rows.items() if name not in elsewhere}
    return rows


def _rendered(path: Path, lot: FileEnsemble, options: PlanOptions, how: dict[str, Any]) -> EnsembleResult:
    """The outcome of some files; where no catalog could be made of them, a failure each."""
    try:
        return run_ensemble(path, lot.members(), lot, options, **how)
    except (ValueError, OSError, RuntimeError) as error:
        if is_catalog(path) or isinstance(error, OSError):
            raise
        return EnsembleResult((), (), {name: f"{type(error).__name__}: {error}" for name in lot.rows}, 0.0)


def _take(arrivals: Arrivals, rows: dict[str, TableRow], result: EnsembleResult, say: Callable[[str], None]) -> None:
    rendered = [member.name for member in result.rendered]
    arrivals.tried([*rendered, *result.skipped], dict(result.failures), rows, clock.monotonic())
    if rendered:
        say(f"rendered {shortened(rendered, 3)}; {len(arrivals.done)} in all")


def space_for(
    catalog: Path,
    pattern: str,
    bounds: Mapping[str, tuple[float, float]],
    units: Sequence[str] = (),
    *,
    more_in_files: bool = False,
) -> ParameterSpace:
    """The parameters that a pattern names, bounded as in a catalog, else as given; `more_in_files`: the files state the others.

    Raises ValueError asking for the bounds that a new catalog lacks: the first dumps can't tell them.
    """
    names = pattern_names(pattern, more_in_files=more_in_files)
    if is_catalog(catalog):
        space = Catalog.open(catalog).plan.space
        if not (set(names) <= set(space.names) if more_in_files else set(names) == set(space.names)):
            raise ValueError(
                f"the pattern names {joined_names(names)}, the parameters of {catalog} are {joined_names(space.names)}"
            )
        return space
    names += tuple(name for name in bounds if more_in_files and name not in names)
    lacking, unknown = [n for n in names if n not in bounds], [n for n in bounds if n not in names]
    if lacking or not names:
        remedy = " ".join(f"--bounds {name} LOW HIGH" for name in lacking or ("NAME",))
        raise ValueError(f"please give {remedy}: dumps to come are not known")
    if unknown:
        raise ValueError(
            f"--bounds of {joined_names(unknown)}, but the pattern names {joined_names(names)}; what files say takes --reader"
        )
    if units and len(units) != len(names):
        raise ValueError(
            f"--units must be of the {len(names)} parameters {joined_names(bounds)}, got {joined_names(units)}"
        )
    unit_of = dict(zip(bounds, units, strict=True)) if units else {}
    return ParameterSpace(tuple(Parameter(name, *bounds[name], unit_of.get(name, "")) for name in names))
