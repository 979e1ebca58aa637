"""Tasks of a worker process: measure the pilots of a run, or render its members."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from catalogs.engines.stopping import StopRequested
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.scene import PlannedMember
from insitu.ensembles.dumps import Dump, FieldSource, MemberRun, dumps_of, identity_of, record_of
from insitu.ensembles.workers import WorkerReport, send
from insitu.fields.cache import save_field
from insitu.fields.location import FieldLocation
from insitu.fields.member_fields import as_fields, time_of
from insitu.hook.session import Session
from insitu.members.planning import Pilot, PlanOptions, measure_pilot
from insitu.members.request import TIMES, Existing
from insitu.members.result import RenderedMember

STOPPING = {errno.ENOSPC, errno.EDQUOT, errno.EROFS}  # disk errors that the next member would meet too


@dataclass(frozen=True)
class MemberOutcome:
    """The outcome of one member: rendered, with the seconds that its field took (None where it was stored), or failed and why."""

    name: str
    rendered: RenderedMember | None = None
    field_seconds: float | None = None
    failure: str = ""


class DiskError(Exception):
    """An error of the disk that the next member would meet too, and what became of the run's members until then."""

    def __init__(self, reason: str, outcomes: Sequence[MemberOutcome]) -> None:
        super().__init__(reason, outcomes)
        self.reason, self.outcomes = reason, outcomes


def measure_pilots(
    source: FieldSource, run: MemberRun, pilots: set[str], nan: str, cache: Path | None, options: PlanOptions
) -> dict[str, Pilot]:
    """In a worker: what the plan needs of the pilots in a run, by name; all fields of an expensive run are stored.

    Raises the error of the first pilot where none could be measured.
    """
    wanted = run if cache is not None else [m for m in run if m.name in pilots]
    by_name: dict[str, Pilot] = {}
    failed: list[Exception] = []
    for dump in dumps_of(source, wanted, cache):
        name = dump.member.name
        try:
            if dump.error is not None:
                raise dump.error
            if name not in pilots:
                _keep(source, dump, cache)
                send(WorkerReport(name, "stored", 1.0))
                continue
            fields = as_fields(dump.field, options.appearances or (), FieldLocation(nan=nan))
            _keep(source, dump, cache)
            send(WorkerReport(name, "pilot", 0.0))
            pilot = measure_pilot(fields, options)
            by_name[name] = replace(pilot, notes=(*fields.notes, *pilot.notes))
            del fields
        except StopRequested:
            raise
        except Exception as error:
            if name in pilots:
                failed.append(error)
        del dump  # its field, before the next is made
    if not by_name:
        raise failed[0]
    return by_name


def _keep(source: FieldSource, dump: Dump, cache: Path | None) -> None:
    if cache is not None and dump.seconds is not None:
        save_field(cache, dump.member.name, identity_of(source, dump.member), dump.field)


def render_run(
    path: Path,
    source: FieldSource,
    run: MemberRun,
    nan: str,
    cache: Path | None,
    replaced: frozenset[str] = frozenset(),
    *,
    coarse_field: bool = True,
) -> list[MemberOutcome]:
    """In a worker: render the members of a run into the catalog, but those that a worker who died has rendered already.

    `replaced` names stored ones that are rendered all the same; without `coarse_field` no coarse fields are stored.

    Raises DiskError where the disk takes no more.
    """
    catalog = Catalog.open(path)
    outcomes: list[MemberOutcome] = []
    for dump in dumps_of(source, [m for m in run if m.name not in catalog or m.name in replaced], cache):
        name = dump.member.name
        try:
            if dump.error is not None:
                raise dump.error
            existing: Existing = "replace" if name in replaced else "error"
            rendered = _rendered(path, source, dump, existing, nan=nan, coarse_field=coarse_field)
        except StopRequested:
            raise
        except Exception as error:
            if name not in replaced and _is_stored(path, dump.member):  # meanwhile, by a worker that was thought dead
                send(WorkerReport(name, "stored", 1.0))
                continue
            hopeless = isinstance(error, OSError) and error.errno in STOPPING
            reason = _disk_reason(error, path) if hopeless else reason_of(error)
            outcomes.append(MemberOutcome(name, failure=reason))
            send(WorkerReport(name, "failed", 1.0))
            if hopeless:
                raise DiskError(reason, outcomes) from None
        else:
            outcomes.append(MemberOutcome(name, rendered, dump.seconds))
            send(WorkerReport(name, "done", 1.0, rendered.images))
        del dump  # its field, before the next is made
    return outcomes


def _rendered(path: Path, source: FieldSource, dump: Dump, existing: Existing, **how: Any) -> RenderedMember:
    member = dump.member

    def progress(images: int) -> None:
        send(WorkerReport(member.name, "render", 0.0, images))

    progress(0)
    stated = any(name in member.parameters for name in TIMES)  # then a file need not know it
    with Session(path, **how, progress=progress, warn=lambda note: None) as session:
        return session.render_member(
            dump.field,
            member.parameters,
            name=member.name,
            split=member.split,
            time=None if stated else time_of(dump.field),
            provenance={"source": record_of(source, member)},
            appearances=member.appearances,
            existing=existing,
        )


def _is_stored(path: Path, member: PlannedMember) -> bool:
    catalog = Catalog.open(path)
    return member.name in catalog and dict(catalog.member(member.name).parameters) == dict(member.parameters)


def _disk_reason(error: Exception, path: Path) -> str:
    """The same for every member, so that it is reported once."""
    return f"{os.strerror(getattr(error, 'errno', None) or errno.EIO)} ({path}): make room or permission"


def reason_of(error: BaseException) -> str:
    return error.reason if isinstance(error, DiskError) else f"{type(error).__name__}: {error}"
