"""Coarse fields for the members of a catalog that were rendered without: from the same sources, and nothing is rendered."""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from catalogs.engines.engine import Engine
from catalogs.engines.stopping import StopRequested
from catalogs.progress import Count, Rate
from catalogs.store.catalog import Catalog, CatalogPlan, Member
from catalogs.store.members import COARSE, has_coarse_fields
from catalogs.vocabulary.appearance import shown_fields
from catalogs.vocabulary.scene import PlannedMember
from catalogs.vocabulary.words import plural
from insitu.ensembles.dumps import Dump, FieldSource, MemberRun, dumps_of, runs_of
from insitu.ensembles.ensemble import (
    EnsembleResult,
    agreeing_ensemble,
    available_cores,
    changed_members,
    local_engine,
    shard_of,
    stored_members,
)
from insitu.ensembles.tasks import reason_of
from insitu.ensembles.workers import single_threaded
from insitu.fields.boxes import checked_box, same_box
from insitu.fields.location import FieldLocation
from insitu.fields.member_fields import Fields, as_fields
from insitu.members.agreement import SOURCE
from insitu.members.planning import PlanOptions
from insitu.members.result import RenderedMember

SAME_RANGE = 1e-4  # of a field's range: a solver that runs again on another machine rounds otherwise


def add_coarse_fields(
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
    progress: Callable[[Any], None] = lambda state: None,
    warn: Callable[[Warning], None] | None = None,
) -> EnsembleResult:
    """Store the coarse fields of every stored member that has none; images and all else stay as they are.

    Arguments are those of `insitu.run_ensemble` that made the catalog.  The result's `rendered` are the members that have them now,
    with no images, `skipped` those that had them.  A member whose field can't be made again, or is another than was rendered, is
    among the failures.  The same call goes on where it was interrupted.

    Raises ValueError where there is no catalog, or it is not of this ensemble.
    """
    started, path = clock.perf_counter(), Path(catalog)
    options = replace(options, provenance={SOURCE: dict(source.identity), **options.provenance})
    existing_catalog, _ = agreeing_ensemble(path, options, members)
    if existing_catalog is None:
        raise ValueError(f"there is no catalog {path}, whose members could be given coarse fields: render it first")
    present = stored_members(existing_catalog, members)
    there = {name for name, member in present.items() if has_coarse_fields(member.path, existing_catalog.plan)}
    changed = set(changed_members(existing_catalog, members, source, present)) if present else set()
    lacking = {name: member.name for name, member in present.items() if name not in there | changed}
    failures = dict.fromkeys(sorted(changed - there), "its file holds another field than was rendered")
    runs = [[m for m in run if m.name in lacking] for run in shard_of(runs_of(source, members), shard)]
    by_task = {run[0].name: run for run in runs if run}
    total, rate, done = sum(map(len, by_task.values())), Rate(), list[str]()

    def settle(task: str, outcomes: dict[str, str]) -> None:
        failures.update({name: reason for name, reason in outcomes.items() if reason})
        done.extend(name for name, reason in outcomes.items() if not reason)
        progress(Count("coarse fields", len(done), total, rate(len(done)), "members"))

    def failed(task: str, error: BaseException) -> None:
        failures.update({member.name: reason_of(error) for member in by_task[task]})

    tasks = {name: partial(coarsen_run, path, source, run, lacking, nan) for name, run in by_task.items()}
    count = min(workers or available_cores(), max(1, len(tasks)))
    if tasks:
        with single_threaded(), nullcontext(engine) if engine else local_engine(count, executor) as hands:
            hands.run(tasks, settle, failed, lambda reports: None)
    rendered = tuple(RenderedMember(lacking[name], path / "members" / lacking[name]) for name in done)
    return EnsembleResult(rendered, tuple(sorted(there)), failures, clock.perf_counter() - started)


def coarsen_run(path: Path, source: FieldSource, run: MemberRun, names: dict[str, str], nan: str) -> dict[str, str]:
    """In a worker: store the coarse fields of a run's members; returns why not, "" where they are stored, by planned name.

    `names` are those in the catalog, by the planned ones.
    """
    catalog = Catalog.open(path)
    reasons: dict[str, str] = {}
    for dump in dumps_of(source, run, None):
        name = dump.member.name
        try:
            _coarsen(catalog, catalog.member(names[name]), dump, nan)
            reasons[name] = ""
        except StopRequested:
            raise
        except Exception as error:
            reasons[name] = reason_of(error)
        del dump  # its field, before the next is made
    return reasons


def _coarsen(catalog: Catalog, member: Member, dump: Dump, nan: str) -> None:
    if dump.error is not None:
        raise dump.error
    appearances = [a for a in catalog.plan.appearances if a.name in set(member.appearances)]
    fields = as_fields(dump.field, appearances, FieldLocation(nan=nan), all_appearances=catalog.plan.appearances)
    _check_same(fields, member, catalog.plan)
    if coarse := fields.coarse(shown_fields(appearances)):
        catalog.add_coarse_fields(member.name, coarse)


def _check_same(fields: Fields, member: Member, plan: CatalogPlan) -> None:
    """Raise ValueError unless box and ranges are those of the fields that were rendered."""
    box = member.provenance.get("bounds")
    if box is not None and not same_box(fields.box, checked_box(box)):
        raise ValueError(f"the field fills {fields.box}, the one that was rendered {checked_box(box)}")
    for name, ends in fields.ranges.items():
        summary = member.summary(name)
        if summary is None:
            continue
        before = summary.minimum, summary.maximum
        slack = SAME_RANGE * (before[1] - before[0]) + SAME_RANGE**2 * max(map(abs, before))
        if max(abs(a - b) for a, b in zip(ends, before, strict=True)) > slack:
            between = " to ".join(f"{value:.6g}" for value in before)
            raise ValueError(
                f"the field {name or plan.field_label('')} has values from {ends[0]:.6g} to {ends[1]:.6g}, the one that was "
                f"rendered {between}: it is another"
            )


def note_on_lacking(catalog: Catalog, command: str) -> str:
    """A sentence on members without coarse fields and the `command` that adds them; "" where all have some."""
    paths = catalog.member_paths()
    lacking = sum(not (path / COARSE).exists() for path in paths)
    if not lacking:
        return ""
    return f"{plural(lacking, 'member')} of {len(paths)} have no coarse field: {command} adds them without rendering"
