"""Many members rendered by worker processes into one catalog; what fails or is interrupted costs nothing else."""

from __future__ import annotations

import errno
import os
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from catalogs.catalog import Catalog
from catalogs.parameters import ParameterSpace
from catalogs.scene import PlannedMember
from insitu.agreement import agreeing_catalog, create_catalog, misplaced
from insitu.field_cache import drop_field, load_field, save_field
from insitu.fields import as_fields, time_of
from insitu.hook import Session, warn_caller
from insitu.planning import Pilot, PlanOptions, check_complete, combine_pilots, measure_pilot
from insitu.progress import EnsembleProgress, Tracker
from insitu.rendered import RenderedMember
from insitu.workers import Report, WorkerPool, send, single_threaded

PILOTS = 2
STOPPING = {errno.ENOSPC, errno.EDQUOT, errno.EROFS}  # disk errors that the next member would meet too


class FieldSource(Protocol):
    """Where the fields of an ensemble's members come from; pickled into every worker process.

    `identity` says in JSON values what a field depends on besides its parameters.  `expensive` fields are computed
    only once: those of the pilot run are stored until they are rendered.
    """

    @property
    def identity(self) -> Mapping[str, Any]: ...

    @property
    def expensive(self) -> bool: ...

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> Any:
        """The member's field or fields (anything `as_fields` takes); `progress` is told the fraction done."""
        ...


@dataclass(frozen=True)
class EnsembleResult:
    """What became of the members: rendered now, present before, or failed and why; and the seconds it took."""

    rendered: tuple[RenderedMember, ...]
    skipped: tuple[str, ...]
    failures: Mapping[str, str]
    seconds: float

    def __repr__(self) -> str:
        images = sum(m.images for m in self.rendered)
        parts = [f"{len(self.rendered)} members rendered ({images} images) in {self.seconds:.1f} s"]
        if self.skipped:
            parts.append(f"{len(self.skipped)} were there already")
        if self.failures:
            parts.append(f"{len(self.failures)} failed")
        return "EnsembleResult: " + ", ".join(parts)

    def __str__(self) -> str:
        return "\n".join([repr(self), *(f"  {name}: {why}" for name, why in self.failures.items())])


def run_ensemble(
    catalog: str | os.PathLike[str],
    members: Sequence[PlannedMember],
    source: FieldSource,
    options: PlanOptions = PlanOptions(),  # noqa: B008 - frozen
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    shard: tuple[int, int] | None = None,
    nan: str = "refuse",
    cache: Path | None = None,
    progress: Callable[[EnsembleProgress], None] | None = None,
    warn: Callable[[Warning], None] | None = None,
) -> EnsembleResult:
    """Render every member that the catalog lacks.

    A new catalog is planned first, on pilot members whose parameters lie farthest apart: its box holds their boxes,
    its sample distance is the finest that any of them needs.

    Parameters
    ----------
    catalog : the `.cdb` directory, made when absent; `options` are what it fixes, or must agree with.
    members : all members of the ensemble; those already in the catalog are skipped.
    source : yields their fields, in the worker processes.
    workers : processes of the default pool (spawned, one thread each); by default one per available core.
    executor : any `concurrent.futures.Executor` instead, such as mpi4py's or dask's; its workers must see the
        same file system.  Progress then moves by whole members.
    shard : (i, n), i from 1 to n: take only every n-th member, starting with the i-th.  n machines that write to one
        shared catalog each take one.
    nan : as in `render_member`.
    cache : folder for the fields of expensive pilots until they are rendered.
    progress : called a few times a second.
    warn : called with each warning about a member, which otherwise is given at the caller's line.

    A member that fails is reported in the result; the others go on, unless the disk is full.  KeyboardInterrupt stops
    the workers, leaves no partial member behind and is raised on; the same call then goes on where it stopped.

    Raises ValueError where the plan is incomplete or another than the catalog's; nothing is written then.
    """
    started = clock.perf_counter()
    path = Path(catalog)
    mine = _shard(members, shard)
    made = _agreeing_catalog(path, options, members)
    present = set() if made is None else {m.name for m in made.members}
    todo = [m for m in mine if m.name not in present]
    skipped = tuple(m.name for m in mine if m.name in present)
    if not todo:
        Catalog.open(path).rebuild_table()  # writes only where a killed run left the table behind its members
        return EnsembleResult((), skipped, {}, clock.perf_counter() - started)
    count = min(workers or available_cores(), len(todo))
    with single_threaded(), WorkerPool(count, executor) as pool:
        kept = cache if source.expensive else None
        run = _Run(path, source, nan, kept, pool, progress or (lambda state: None), warn or warn_caller)
        if made is None:
            space, _ = check_complete(options)
            run.plan(pilot_members(members, space), options, len(todo))
        rendered, failures = run.render(todo)
    return EnsembleResult(tuple(rendered), skipped, failures, clock.perf_counter() - started)


def pilot_members(members: Sequence[PlannedMember], space: ParameterSpace, count: int = PILOTS) -> list[PlannedMember]:
    """Up to `count` training members that lie far apart: the lowest corner's, then always the farthest from those taken.

    Farthest-point sampling (Gonzalez 1985) in parameters normalized to their bounds.
    """
    training = [m for m in members if m.split == "train"] or list(members)
    points = space.normalize([[m.parameters[n] for n in space.names] for m in training])  # [M, P]
    taken = [int(np.argmin(points.sum(axis=1)))]
    distances = np.linalg.norm(points - points[taken[0]], axis=1)  # [M]
    while len(taken) < min(count, len(training)):
        taken.append(int(np.argmax(distances)))
        distances = np.minimum(distances, np.linalg.norm(points - points[taken[-1]], axis=1))
    return [training[i] for i in taken]


def available_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class _Run:
    """One call of `run_ensemble`: what its tasks share."""

    path: Path
    source: FieldSource
    nan: str
    cache: Path | None
    pool: WorkerPool
    show: Callable[[EnsembleProgress], None]
    warn: Callable[[Warning], None]

    def plan(self, pilots: Sequence[PlannedMember], options: PlanOptions, members: int) -> None:
        """Make the catalog from what the pilots show; raises what the first failing pilot raised."""
        tracker = Tracker(members, 0, field_share=1.0)
        found: dict[str, Pilot] = {}
        failures: dict[str, BaseException] = {}

        def done(name: str, pilot: Pilot) -> None:
            tracker.idle(name)
            found[name] = pilot
            self._tell(name, pilot.notes)

        tasks = {m.name: partial(_measure, self.source, m, self.nan, self.cache, options) for m in pilots}
        self.pool.run(tasks, done, failures.__setitem__, partial(self._tick, tracker))
        if not found:
            raise next(iter(failures.values()))  # a pilot that fails alone is reported when its turn comes
        create_catalog(self.path, combine_pilots([found[m.name] for m in pilots if m.name in found]), options)

    def render(self, members: Sequence[PlannedMember]) -> tuple[list[RenderedMember], dict[str, str]]:
        """What was rendered, and why others were not, by name."""
        plan = Catalog.open(self.path).plan
        shown = [len(plan.appearances if m.appearances is None else m.appearances) for m in members]
        images = round(len(plan.cameras) * sum(shown) / max(1, len(shown)))
        tracker = Tracker(len(members), images, field_share=0.5 if self.source.expensive else 0.02)
        rendered: list[RenderedMember] = []
        failures: dict[str, str] = {}

        def done(name: str, result: tuple[RenderedMember, float | None]) -> None:
            member, field_seconds = result
            tracker.done(name, member.images)
            if field_seconds is not None:
                tracker.timed(field_seconds, member.seconds)
            rendered.append(member)
            self._tell(name, member.warnings)
            if self.cache is not None:
                drop_field(self.cache, name)

        def failed(name: str, error: BaseException) -> None:
            tracker.failed(name)
            failures[name] = f"{type(error).__name__}: {error}"

        tasks = {m.name: partial(_render, self.path, self.source, m, self.nan, self.cache) for m in members}
        self.pool.run(tasks, done, failed, partial(self._tick, tracker), _is_hopeless)
        return rendered, failures

    def _tick(self, tracker: Tracker, reports: Iterable[Report]) -> None:
        for report in reports:
            tracker.report(report)
        self.show(tracker.snapshot())

    def _tell(self, name: str, notes: Iterable[str]) -> None:
        """Warn in this process of what a member's worker noted."""
        for note in notes:
            self.warn(UserWarning(f"{name}: {note}"))


def _measure(source: FieldSource, member: PlannedMember, nan: str, cache: Path | None, options: PlanOptions) -> Pilot:
    """In a worker: what the plan needs of a pilot's field, which is stored if it is expensive."""
    field, _ = _field(source, member, cache)
    fields = as_fields(field, options.appearances or (), nan=nan)
    if cache is not None:
        save_field(cache, member.name, _identity(source, member), field)
    send(Report(member.name, "pilot", 0.0))
    pilot = measure_pilot(fields, options)
    return replace(pilot, notes=(*fields.notes, *pilot.notes))


def _render(
    path: Path, source: FieldSource, member: PlannedMember, nan: str, cache: Path | None
) -> tuple[RenderedMember, float | None]:
    """In a worker: render a member into the catalog; returns it and the seconds that its field took (see `_field`)."""
    field, seconds = _field(source, member, cache)

    def progress(images: int) -> None:
        send(Report(member.name, "render", 0.0, images))

    progress(0)
    with Session(path, nan=nan, progress=progress, warn=lambda note: None) as session:
        rendered = session.render_member(
            field,
            member.parameters,
            name=member.name,
            split=member.split,
            time=time_of(field),
            provenance={"source": dict(source.identity)},
            appearances=member.appearances,
        )
    return rendered, seconds


def _field(source: FieldSource, member: PlannedMember, cache: Path | None) -> tuple[Any, float | None]:
    """The member's field, and the seconds it took; None where the pilot run has stored it."""
    started = clock.perf_counter()
    field = None if cache is None else load_field(cache, member.name, _identity(source, member))
    if field is not None:
        return field, None
    send(Report(member.name, "simulate" if source.expensive else "read", 0.0))
    field = source.field(member, lambda fraction: send(Report(member.name, "simulate", fraction)))
    return field, clock.perf_counter() - started


def _identity(source: FieldSource, member: PlannedMember) -> dict[str, Any]:
    return {"source": dict(source.identity), "parameters": dict(member.parameters)}


def _is_hopeless(error: BaseException) -> bool:
    return isinstance(error, OSError) and error.errno in STOPPING


def _agreeing_catalog(path: Path, options: PlanOptions, members: Sequence[PlannedMember]) -> Catalog | None:
    """The catalog at `path`, if there is one; raises ValueError where it is not this ensemble's."""
    catalog = agreeing_catalog(path, options)
    differences = [] if catalog is None else misplaced(catalog, members)
    if differences:
        raise ValueError(f"catalog {path} holds members of another ensemble: {'; '.join(differences[:5])}")
    return catalog


def _shard(members: Sequence[PlannedMember], shard: tuple[int, int] | None) -> list[PlannedMember]:
    if shard is None:
        return list(members)
    index, count = shard
    if not 1 <= index <= count:
        raise ValueError(f"shard must be i/n with 1 <= i <= n, got {index}/{count}")
    return list(members[index - 1 :: count])
