"""Members that are dumps of one run of a simulation: grouped, and their fields one after the other."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from catalogs.engines.stopping import StopRequested
from catalogs.vocabulary.scene import PlannedMember
from insitu.ensembles.workers import WorkerReport, send
from insitu.fields.cache import load_field

TIME = "time"  # the parameter by which members are dumps of one run

MemberRun = Sequence[PlannedMember]
"""Members whose fields come from one run, in the order in which they come; often just one."""


class FieldSource(Protocol):
    """The source of an ensemble's fields; pickled into every worker process.

    `identity` says in JSON values what a field depends on besides its parameters.  `expensive` fields are computed
    only once: those of the pilot run are stored until they are rendered.
    """

    @property
    def identity(self) -> Mapping[str, Any]: ...

    @property
    def expensive(self) -> bool: ...

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> Any:
        """The member's field or fields (anything `as_fields` takes); `progress` is called with the fraction done."""
        ...


@runtime_checkable
class RunSource(FieldSource, Protocol):
    """A source of which several members may come from one run."""

    def runs(self, members: Sequence[PlannedMember]) -> Sequence[MemberRun]:
        """All the members, grouped by run."""
        ...

    def dumps(self, run: MemberRun, progress: Callable[[float], None]) -> Iterator[Any]:
        """The fields of each member of a run, or of some of them, one after the other, as `field` gives them.

        A member's field does not depend on the others in `run`; `progress` is called with the fraction of the way to the next.
        """
        ...


@runtime_checkable
class FileSource(FieldSource, Protocol):
    """A source whose fields lie in files, which may be others than those that stored members were rendered from."""

    def record(self, member: PlannedMember) -> Mapping[str, Any]:
        """The record of a member's field in JSON values: `identity`, and the contents of its file."""
        ...

    def is_changed(self, member: PlannedMember, before: Mapping[str, Any]) -> bool:
        """True if the member's file holds something else than when `before` was its `record`."""
        ...


def record_of(source: FieldSource, member: PlannedMember) -> dict[str, Any]:
    """The source of a member's field, as it is recorded with the member."""
    return dict(source.record(member) if isinstance(source, FileSource) else source.identity)


def runs_of(source: FieldSource, members: Sequence[PlannedMember]) -> list[MemberRun]:
    """The members grouped by run: each alone where the source knows of no runs."""
    return list(source.runs(members)) if isinstance(source, RunSource) else [(member,) for member in members]


def runs_in_time(members: Sequence[PlannedMember]) -> list[tuple[PlannedMember, ...]]:
    """The members grouped by run, those that are equal in all parameters but "time", and each run's in the order of time."""
    runs: dict[tuple[tuple[str, float], ...], list[PlannedMember]] = {}
    for member in members:
        runs.setdefault(tuple(sorted(but_time(member).items())), []).append(member)
    return [tuple(sorted(run, key=lambda m: m.parameters[TIME])) for run in runs.values()]


def but_time(member: PlannedMember) -> dict[str, float]:
    """The member's parameters without the time."""
    return {name: value for name, value in member.parameters.items() if name != TIME}


@dataclass(frozen=True)
class Dump:
    """A member's field, or the error in its place; the seconds that it took, None where it was stored."""

    member: PlannedMember
    field: Any
    seconds: float | None
    error: Exception | None = None


def dumps_of(source: FieldSource, run: MemberRun, cache: Path | None) -> Iterator[Dump]:
    """The fields of a run's members, one in memory at a time; those that `cache` holds are not computed again.

    Where the source raises an error, it stands in the place of the rest of the run's fields.
    """
    cached = set() if cache is None else {m.name for m in run if load_field(cache, m.name, identity_of(source, m))}
    awaited = ""

    def progress(fraction: float) -> None:
        send(WorkerReport(awaited, "simulate", fraction))

    computed = _computed(source, [m for m in run if m.name not in cached], progress)
    error: Exception | None = None
    for member in run:
        if cache is not None and member.name in cached:
            yield Dump(member, load_field(cache, member.name, identity_of(source, member)), None)
            continue
        awaited, started, field = member.name, clock.perf_counter(), None
        send(WorkerReport(awaited, "simulate" if source.expensive else "read", 0.0))
        try:
            field = next(computed) if error is None else None
        except StopRequested:
            raise
        except StopIteration:
            error = RuntimeError(f"the source ended before member {member.name}")
        except Exception as failure:
            error = failure
        yield Dump(member, field, clock.perf_counter() - started, error)


def identity_of(source: FieldSource, member: PlannedMember) -> dict[str, Any]:
    """The JSON values on which a member's field depends."""
    return {"source": dict(source.identity), "parameters": dict(member.parameters)}


def _computed(source: FieldSource, run: MemberRun, progress: Callable[[float], None]) -> Iterator[Any]:
    if isinstance(source, RunSource):
        yield from source.dumps(run, progress)
    else:
        for member in run:
            yield source.field(member, progress)
