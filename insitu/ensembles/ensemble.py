"""Many members rendered by worker processes into one catalog; what fails or is interrupted costs nothing else."""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from catalogs.engines.engine import Engine
from catalogs.engines.executors import OnExecutor
from catalogs.store.catalog import Catalog, Member
from catalogs.store.missing import report_missing
from catalogs.vocabulary.farthest import farthest_points
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.scene import PlannedMember
from catalogs.vocabulary.words import plural, shortened
from insitu.ensembles.dumps import FieldSource, FileSource, MemberRun, runs_of
from insitu.ensembles.files import FileEnsemble
from insitu.ensembles.progress import EnsembleProgress, Tracker
from insitu.ensembles.tasks import DiskError, MemberOutcome, measure_pilots, reason_of, render_run
from insitu.ensembles.workers import WorkerPool, WorkerReport, single_threaded
from insitu.fields.cache import drop_field
from insitu.members.agreement import SOURCE, agreeing_catalog, create_catalog, misplaced
from insitu.members.beginning import check_new
from insitu.members.failures import warn_caller
from insitu.members.notes import Once
from insitu.members.planning import Pilot, PlanOptions, check_complete, combine_pilots
from insitu.members.request import Existing, MemberArguments, member_request
from insitu.members.result import RenderedMember

PILOTS = 2


@dataclass(frozen=True)
class EnsembleResult:
    """Members rendered now, members skipped, failures with their reasons, and the seconds it took.

    Examples
    --------
    >>> import insitu
    >>> print(insitu.EnsembleResult(rendered=(), skipped=("first",), failures={"second": "NaN at step 40"}, seconds=0.1))
    EnsembleResult: 0 members rendered (0 images) in 0.1 s, 1 were there already, 1 failed
      second: NaN at step 40
    """

    rendered: tuple[RenderedMember, ...]
    skipped: tuple[str, ...]
    failures: Mapping[str, str]
    seconds: float

    def __repr__(self) -> str:
        images = sum(m.images for m in self.rendered)
        parts = [f"{plural(len(self.rendered), 'member')} rendered ({plural(images, 'image')}) in {self.seconds:.1f} s"]
        if self.skipped:
            parts.append(f"{len(self.skipped)} were there already")
        if self.failures:
            parts.append(f"{len(self.failures)} failed")
        return "EnsembleResult: " + ", ".join(parts)

    def __str__(self) -> str:
        return "\n".join([repr(self), *failure_lines(self.failures)])


def failure_lines(failures: Mapping[str, str]) -> list[str]:
    """Why members failed, each reason once with how many it holds for."""
    by_reason: dict[str, list[str]] = {}
    for name, why in failures.items():
        by_reason.setdefault(why, []).append(name)
    return [f"  {counted_names(names)}: {why}" for why, names in by_reason.items()]


def counted_names(names: Sequence[str]) -> str:
    """One name, or how many and the first of them."""
    return names[0] if len(names) == 1 else f"{len(names)} members ({shortened(names, 4)})"


def run_ensemble(
    catalog: str | os.PathLike[str],
    members: Sequence[PlannedMember],
    source: FieldSource,
    options: PlanOptions = PlanOptions(),  # noqa: B008 - frozen
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    engine: Engine | None = None,
    shard: tuple[int, int] | None = None,
    nan: str = "refuse",
    existing: Existing = "error",
    cache: Path | None = None,
    progress: Callable[[EnsembleProgress], None] | None = None,
    warn: Callable[[Warning], None] | None = None,
) -> EnsembleResult:
    """Render every member that the catalog lacks.

    A new catalog is planned first, on pilot members that lie farthest apart: its box holds theirs, its rays' samples serve all.

    Parameters
    ----------
    catalog : the `.cdb` directory, made when absent; `options` are what it fixes, or must agree with.
    members : all members of the ensemble; those already in the catalog are skipped.
    source : yields their fields, in the worker processes; of one run (see `RunSource`) all in the same process.
    workers : processes of the default pool, by default one per available core.
    executor, engine : any `concurrent.futures.Executor` instead, whose workers must see the same file system, or a running engine.
    shard : (i, n), i from 1 to n: every n-th run is taken, starting with the i-th.  `nan` is as in `render_member`.
    existing : for stored members whose file has changed since: "error" raises naming them, "skip" keeps them, "replace" renders
        them anew.  Those whose file is the same are always skipped.
    cache : folder for the fields of expensive pilots until they are rendered.
    progress, warn : called a few times a second, and with each kind of warning once; by default it is given at the caller's line.

    A member that fails is in the result, and missing in the catalog; the others go on, unless the disk is full.
    KeyboardInterrupt stops the workers, leaves no partial member and is raised on; the same call goes on where it stopped.
    Raises ValueError or OSError where the plan is incomplete or not the catalog's, or a member's parameters are wrong, before any
    field is read or anything is written.

    Examples
    --------
    >>> import insitu
    >>> from blobs import APPEARANCE, simulate_field
    >>> from catalogs.vocabulary.scene import PlannedMember
    >>> from insitu.ensembles.function_source import HookedSource
    >>> from insitu.members.planning import PlanOptions
    >>> space = insitu.ParameterSpace((insitu.Parameter("separation", 0.6, 1.0), insitu.Parameter("width", 0.2, 0.4)))
    >>> points = [dict(zip(space.names, point)) for point in space.latin_hypercube(4, seed=0).tolist()]
    >>> members = [PlannedMember(f"run-{i}", point, "train") for i, point in enumerate(points)]
    >>> options = PlanOptions(space, (APPEARANCE,), insitu.ViewPlan(frequency=1, width=32, height=32))
    >>> insitu.run_ensemble("runs.cdb", members, HookedSource(simulate_field, "blobs"), options, workers=1)
    EnsembleResult: 4 members rendered (48 images) in ... s
    """
    started, path = clock.perf_counter(), Path(catalog)
    runs = runs_of(source, members)
    options = replace(options, provenance={SOURCE: dict(source.identity), **options.provenance})
    existing_catalog, space = agreeing_ensemble(path, options, members)
    present, changed = _present(path, existing_catalog, members, source, existing)
    todo, skipped = _split_off(shard_of(runs, shard), present)
    if not todo:
        Catalog.open(path).rebuild_table()  # writes only where a killed run left the table behind its members
        return EnsembleResult((), skipped, _unread(source, path), clock.perf_counter() - started)
    count = min(workers or available_cores(), len(todo))
    with single_threaded(), nullcontext(engine) if engine else local_engine(count, executor) as hands:
        field_cache = cache if source.expensive else None
        show, once = progress or (lambda state: None), Once(warn or warn_caller)
        work = _EnsembleRun(path, source, nan, field_cache, hands, show, once, changed, options.coarse_field)
        if existing_catalog is None:
            work.plan(runs, pilot_members(members, space), options, sum(map(len, todo)))
        rendered, there, failures = work.render(todo)
        once.repeat(rendered)
    Catalog.open(path).rebuild_table()  # in the order of names, whoever was first
    failures |= _unread(source, path)
    return EnsembleResult(tuple(rendered), (*skipped, *there), failures, clock.perf_counter() - started)


def pilot_members(members: Sequence[PlannedMember], space: ParameterSpace, count: int = PILOTS) -> list[PlannedMember]:
    """Up to `count` training members that lie far apart: the lowest corner's, then always the farthest from those taken.

    Distances are those of parameters normalized to their bounds.
    """
    training = [m for m in members if m.split == "train"] or list(members)
    points = space.normalize([[m.parameters[n] for n in space.names] for m in training])  # [M, P]
    numbers = farthest_points(points, count, int(np.argmin(points.sum(axis=1))))
    return [training[i] for i in numbers]


def available_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def local_engine(count: int, executor: Executor | None) -> AbstractContextManager[Engine]:
    """`count` workers of our own, or an `executor`'s."""
    return WorkerPool(count) if executor is None else nullcontext(OnExecutor(executor))


@dataclass(frozen=True)
class _EnsembleRun:
    """One call of `run_ensemble`: what its tasks share."""

    path: Path
    source: FieldSource
    nan: str
    cache: Path | None
    engine: Engine
    show: Callable[[EnsembleProgress], None]
    once: Once
    replaced: frozenset[str]  # stored members that are rendered anew
    coarse_field: bool

    def plan(
        self, runs: Sequence[MemberRun], pilots: Sequence[PlannedMember], options: PlanOptions, members: int
    ) -> None:
        """Make the catalog from what the pilots show; raises what the first failing pilot raised."""
        tracker = Tracker(members, 0, field_share=1.0)
        names = {m.name for m in pilots}
        pilot_by_name: dict[str, Pilot] = {}
        failures: dict[str, BaseException] = {}

        def done(_: str, measured: dict[str, Pilot]) -> None:
            pilot_by_name.update(measured)
            for name, pilot in measured.items():
                tracker.idle(name)
                self.once.say(name, pilot.notes)

        tasks = {
            run[0].name: partial(measure_pilots, self.source, run, names, self.nan, self.cache, options)
            for run in runs
            if names & {m.name for m in run}
        }
        self.engine.run(tasks, done, failures.__setitem__, partial(self._tick, tracker))
        if not pilot_by_name:
            raise next(iter(failures.values()))  # a pilot that fails alone is reported when its turn comes
        create_catalog(
            self.path, combine_pilots([pilot_by_name[m.name] for m in pilots if m.name in pilot_by_name]), options
        )

    def render(self, runs: Sequence[MemberRun]) -> tuple[list[RenderedMember], list[str], dict[str, str]]:
        """The rendered members, the names of members found stored all the same, and the reasons of failures by name."""
        catalog = Catalog.open(self.path)
        plan, members = catalog.plan, [m for run in runs for m in run]
        parameters = {m.name: m.parameters for m in members}
        appearance_counts = [len(plan.appearances if m.appearances is None else m.appearances) for m in members]
        images = round(len(plan.cameras) * sum(appearance_counts) / max(1, len(appearance_counts)))
        tracker = Tracker(len(members), images, field_share=0.5 if self.source.expensive else 0.02)
        by_task = {run[0].name: run for run in runs}
        rendered: list[RenderedMember] = []
        there: list[str] = []
        failures: dict[str, str] = {}

        def finish(outcome: MemberOutcome) -> None:
            if outcome.rendered is None:
                failures[outcome.name] = outcome.failure
                with suppress(OSError):  # a disk that refuses has no say
                    report_missing(self.path, outcome.name, parameters[outcome.name], outcome.failure)
                tracker.failed(outcome.name)
                return
            tracker.done(outcome.name, outcome.rendered.images)
            if outcome.field_seconds is not None:
                tracker.timed(outcome.field_seconds, outcome.rendered.seconds)
            rendered.append(outcome.rendered)
            self.once.say(outcome.name, outcome.rendered.warnings)
            if self.cache is not None:
                drop_field(self.cache, outcome.name)

        def settle(task: str, outcomes: Sequence[MemberOutcome], reason: str = "") -> None:
            by_name = {outcome.name: outcome for outcome in outcomes}
            for member in by_task[task]:
                if member.name in by_name:
                    finish(by_name[member.name])
                elif not reason or (
                    member.name in catalog and member.name not in self.replaced
                ):  # by a worker before it died, or by another process
                    there.append(member.name)
                    tracker.done(member.name, images)
                else:
                    finish(MemberOutcome(member.name, failure=reason))

        def failed(task: str, error: BaseException) -> None:
            settle(task, getattr(error, "outcomes", ()), reason_of(error))

        tasks = {
            name: partial(
                render_run,
                self.path,
                self.source,
                run,
                self.nan,
                self.cache,
                self.replaced,
                coarse_field=self.coarse_field,
            )
            for name, run in by_task.items()
        }
        self.engine.run(tasks, settle, failed, partial(self._tick, tracker), lambda error: isinstance(error, DiskError))
        return rendered, there, failures

    def _tick(self, tracker: Tracker, reports: Iterable[WorkerReport]) -> None:
        for report in reports:
            tracker.report(report)
        self.show(tracker.snapshot())


def agreeing_ensemble(
    path: Path, options: PlanOptions, members: Sequence[PlannedMember]
) -> tuple[Catalog | None, ParameterSpace]:
    """The catalog at `path`, if there is one, and the parameters; raises ValueError where it is not this ensemble's."""
    catalog = agreeing_catalog(path, options)
    if catalog is None:
        check_new(path, options)
    space, appearances = check_complete(options) if catalog is None else (catalog.plan.space, catalog.plan.appearances)
    for member in members:
        try:
            arguments = MemberArguments(member.parameters, member.name, member.split, appearances=member.appearances)
            member_request(space, appearances, arguments)
        except ValueError as error:
            raise ValueError(f"member {member.name}: {error}") from None
    differences = [] if catalog is None else misplaced(catalog, members)
    if differences:
        raise ValueError(f"catalog {path} holds members of another ensemble: {'; '.join(differences[:5])}")
    return catalog, space


def _present(
    path: Path, catalog: Catalog | None, members: Sequence[PlannedMember], source: FieldSource, existing: Existing
) -> tuple[set[str], frozenset[str]]:
    """Names of stored members that stay, and of those to render anew; raises ValueError where `existing` forbids these."""
    if catalog is None:
        return set(), frozenset()
    present = stored_members(catalog, members)
    changed = [] if existing == "skip" else changed_members(catalog, members, source, present)
    if existing == "error":
        _refuse_changed(path, changed)
    return present.keys() - set(changed), frozenset(changed)


def stored_members(catalog: Catalog, members: Sequence[PlannedMember]) -> dict[str, Member]:
    """Stored members by the names of planned ones: of the same name, else of the same parameters."""
    present, names = catalog.members, catalog.plan.space.names
    by_name = {m.name: m for m in present}
    by_values = {tuple(m.parameters[n] for n in names): m for m in present}
    same = {m.name: by_name.get(m.name) or by_values.get(tuple(m.parameters[n] for n in names)) for m in members}
    return {name: member for name, member in same.items() if member is not None}


def _unread(source: FieldSource, path: Path) -> dict[str, str]:
    """Files of the source whose members are unknown, and why, by name; the catalog at `path` lists them as missing."""
    return source.report_unread(path) if isinstance(source, FileEnsemble) else {}


def _split_off(
    runs: Sequence[MemberRun], present: Collection[str]
) -> tuple[list[list[PlannedMember]], tuple[str, ...]]:
    """The members of runs that are not present, by run, and the names of the others."""
    todo = [[m for m in run if m.name not in present] for run in runs]
    return [run for run in todo if run], tuple(m.name for run in runs for m in run if m.name in present)


def changed_members(
    catalog: Catalog, members: Sequence[PlannedMember], source: FieldSource, present: Mapping[str, Member]
) -> list[str]:
    """Planned members whose file holds something else than was stored; where none is stored, the first if the plan's does."""
    if not isinstance(source, FileSource):
        return []
    if not present:
        before = catalog.plan.provenance.get(SOURCE, {})
        return [m.name for m in members[:1] if source.is_changed(m, before)]
    common = [m for m in members if m.name in present]
    return [m.name for m in common if source.is_changed(m, present[m.name].provenance.get(SOURCE, {}))]


def _refuse_changed(path: Path, changed: Sequence[str]) -> None:
    if changed:
        raise ValueError(
            f"catalog {path} holds pictures of other contents of the files than they have now, of {counted_names(changed)}: "
            "keep these (existing: skip), render them anew (replace), or write to a new catalog"
        )


def shard_of(runs: Sequence[MemberRun], shard: tuple[int, int] | None) -> list[MemberRun]:
    if shard is None:
        return list(runs)
    index, count = shard
    if not 1 <= index <= count:
        raise ValueError(f"shard must be i/n with 1 <= i <= n, got {index}/{count}")
    return list(runs[index - 1 :: count])
