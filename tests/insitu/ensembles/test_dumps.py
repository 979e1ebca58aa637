"""Dumps of one run: simulated once, rendered one by one, and none lost with another."""

from __future__ import annotations

import itertools
import os
import signal
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.engines.stopping import StopRequested
from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import PlannedMember, ViewPlan
from insitu.ensembles.dumps import MemberRun, dumps_of, runs_of
from insitu.ensembles.ensemble import run_ensemble
from insitu.ensembles.tasks import render_run
from insitu.fields.field import Field
from insitu.members.planning import PlanOptions
from tests.support.executors import AtOnce

pytestmark = pytest.mark.usefixtures("prepared_workers")

SPACE = ParameterSpace((Parameter("w", 0.0, 3.0), Parameter("t", 0.0, 4.0)))
VOLUME = VolumeRendering(
    "dvr", TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.2, 0.0), (1.0, 0.6)), 0.3)
)
OPTIONS = PlanOptions(SPACE, (VOLUME,), ViewPlan(frequency=1, width=8, height=8), sample_distance=0.2)
AXIS = np.linspace(-1.0, 1.0, 6)


@dataclass(frozen=True)
class Marching:
    """A "simulation" that steps w through t = 1, 2, 3, ..., with accidents by (w, t); every step leaves a line in `log`."""

    log: str
    accidents: tuple[tuple[tuple[int, int], str], ...] = ()
    expensive: bool = True

    @property
    def identity(self) -> Mapping[str, Any]:
        return {"kind": "marching"}

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> Field:
        return next(self.dumps([member], progress))

    def runs(self, members: Sequence[PlannedMember]) -> list[MemberRun]:
        widths = dict.fromkeys(m.parameters["w"] for m in members)
        runs = [[m for m in members if m.parameters["w"] == w] for w in widths]
        return [sorted(run, key=lambda m: m.parameters["t"]) for run in runs]

    def dumps(self, run: MemberRun, progress: Callable[[float], None]) -> Iterator[Field]:
        width, step = int(run[0].parameters["w"]), 0
        for member in run:
            while step < member.parameters["t"]:
                step += 1
                self._note(f"{width}@{step}")
                progress(step / member.parameters["t"])
            yield self._dump(width, step)

    def _dump(self, width: int, step: int) -> Field:
        accident = dict(self.accidents).get((width, step), "")
        if accident == "blows up":
            raise FloatingPointError(f"not finite at {step}")
        if accident == "die" or (accident == "die once" and Path(self.log).read_text().count(f"{width}@{step}") == 1):
            os.kill(os.getpid(), signal.SIGKILL)
        z, y, x = np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")
        values = np.exp(-(x**2 + y**2 + z**2) / (0.2 + 0.1 * width + 0.1 * step)).astype(np.float32)
        return Field(values * (np.nan if accident == "nan" else 1.0), (0.4,) * 3, (0.0,) * 3, time=float(step))

    def _note(self, line: str) -> None:
        with open(self.log, "a") as log:
            log.write(line + "\n")


def planned(runs: int = 3, dumps: int = 4) -> list[PlannedMember]:
    """Members w.t, latest first, so that the order of a run is not that of the plan."""
    return [
        PlannedMember(f"m{w}{t}", {"w": float(w), "t": float(t)}, "train")
        for t in range(dumps, 0, -1)
        for w in range(runs)
    ]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log"
    path.touch()
    return path


def steps(log: Path, width: int) -> list[int]:
    return [int(line.split("@")[1]) for line in log.read_text().split() if line.startswith(f"{width}@")]


def names(path: Path) -> list[str]:
    return [m.name for m in Catalog.open(path).members]


def test_a_run_is_simulated_once_and_its_dumps_are_those_of_their_time(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "a.cdb"
    result = run_ensemble(path, planned(), Marching(str(log)), OPTIONS, executor=AtOnce(), cache=tmp_path / "pilots")
    assert len(result.rendered) == 12
    assert names(path) == sorted(m.name for m in planned())
    assert [steps(log, w) for w in range(3)] == [[1, 2, 3, 4]] * 3, "pilots' runs as well"
    assert not (tmp_path / "pilots").exists()
    assert check(path) == []
    for member in Catalog.open(path).members:
        assert member.provenance["time"] == member.parameters["t"]


def test_only_what_the_catalog_lacks_is_simulated_and_no_longer_than_needed(tmp_path: Path, log: Path) -> None:
    path, source = tmp_path / "a.cdb", Marching(str(log))
    run_ensemble(path, [m for m in planned() if m.name in ("m01", "m24")], source, OPTIONS, executor=AtOnce())
    log.write_text("")
    wanted = [m for m in planned() if m.name in ("m01", "m02", "m24", "m13")]
    again = run_ensemble(path, wanted, source, OPTIONS, executor=AtOnce())
    assert sorted(again.skipped) == ["m01", "m24"]
    assert (steps(log, 0), steps(log, 1), steps(log, 2)) == ([1, 2], [1, 2, 3], [])


@pytest.mark.slow
def test_a_dump_that_cannot_be_rendered_leaves_the_others(tmp_path: Path, log: Path) -> None:
    path, source = tmp_path / "a.cdb", Marching(str(log), (((1, 2), "nan"),))
    result = run_ensemble(path, planned(), source, OPTIONS, workers=2)
    assert set(result.failures) == {"m12"}
    assert "NaN" in result.failures["m12"]
    assert names(path) == sorted(m.name for m in planned() if m.name != "m12")


def test_a_run_that_blows_up_keeps_what_came_before(tmp_path: Path, log: Path) -> None:
    path, source = tmp_path / "a.cdb", Marching(str(log), (((0, 3), "blows up"),))
    result = run_ensemble(path, planned(), source, OPTIONS, executor=AtOnce(), cache=tmp_path / "pilots")
    assert result.failures == dict.fromkeys(("m03", "m04"), "FloatingPointError: not finite at 3")
    assert len(names(path)) == 10


@pytest.mark.slow
@pytest.mark.parametrize(("accident", "failed"), [("die once", set()), ("die", {"m13", "m14"})])
def test_a_killed_worker_loses_at_most_the_rest_of_its_run(
    tmp_path: Path, log: Path, accident: str, failed: set[str]
) -> None:
    path, source = tmp_path / "a.cdb", Marching(str(log), (((1, 3), accident),))
    result = run_ensemble(path, planned(), source, OPTIONS, workers=1)
    assert set(result.failures) == failed
    assert set(names(path)) == {m.name for m in planned()} - failed
    assert {m.name for m in result.rendered} | set(result.skipped) == set(names(path))
    assert run_ensemble(path, planned(), Marching(str(log)), OPTIONS, executor=AtOnce()).failures == {}
    assert len(names(path)) == 12


def test_shards_split_by_run(tmp_path: Path, log: Path) -> None:
    path, source = tmp_path / "a.cdb", Marching(str(log), expensive=False)
    run_ensemble(path, planned(), source, OPTIONS, executor=AtOnce(), shard=(2, 3))
    assert names(path) == ["m11", "m12", "m13", "m14"]
    for index in (1, 3):
        run_ensemble(path, planned(), source, OPTIONS, executor=AtOnce(), shard=(index, 3))
    assert len(names(path)) == 12


@pytest.mark.slow
def test_progress_counts_dumps_as_they_come(tmp_path: Path, log: Path) -> None:
    states: list[Any] = []
    run_ensemble(tmp_path / "a.cdb", planned(1), Marching(str(log)), OPTIONS, workers=1, progress=states.append)
    assert (states[-1].members_done, states[-1].members, states[-1].images_done) == (4, 4, 48)
    assert [s.members_done for s in states] == sorted(s.members_done for s in states)
    assert all(s.images_done <= s.images for s in states if s.images)


def test_one_field_is_in_memory_at_a_time(tmp_path: Path, log: Path) -> None:
    alive: list[weakref.ref[Any]] = []

    @dataclass(frozen=True)
    class Watching(Marching):
        def _dump(self, width: int, step: int) -> Field:
            assert [ref() for ref in alive if ref() is not None] == [], "the field before must have gone"
            field = Marching._dump(self, width, step)
            alive.append(weakref.ref(field.values))
            return field

    result = run_ensemble(tmp_path / "a.cdb", planned(1), Watching(str(log)), OPTIONS, executor=AtOnce())
    assert (len(result.rendered), result.failures) == (4, {})
    assert len(alive) == 6, "two pilots and four dumps"


def test_a_source_that_ends_early_or_is_interrupted_is_told_apart(log: Path) -> None:
    @dataclass(frozen=True)
    class Short(Marching):
        def dumps(self, run: MemberRun, progress: Callable[[float], None]) -> Iterator[Field]:
            yield from Marching.dumps(self, run[:1], progress)
            if self.accidents:
                raise StopRequested

    run = Short(str(log)).runs(planned(1))[0]
    first, second, *_ = dumps_of(Short(str(log)), run, None)
    assert (first.error, first.field.time) == (None, 1.0)
    assert "ended before member m02" in str(second.error)
    with pytest.raises(StopRequested):
        list(dumps_of(Short(str(log), (((9, 9), ""),)), run, None))


def test_a_member_whose_task_is_taken_back_leaves_nothing(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, source, asked = tmp_path / "a.cdb", Marching(str(log)), itertools.count()
    run_ensemble(path, planned(1), source, OPTIONS, executor=AtOnce())
    before = names(path)
    monkeypatch.setattr(
        "insitu.ensembles.workers.stop_requested", lambda: next(asked) > 8
    )  # within the first member's pictures
    with pytest.raises(StopRequested):
        render_run(path, source, source.runs(planned(2))[1], "error", None)
    assert next(asked) == 10
    assert names(path) == before
    assert Catalog.open(path).unfinished() == []
    assert check(path) == []


def test_a_source_without_runs_has_members_alone(log: Path) -> None:
    class Plain:
        identity: Mapping[str, Any] = {}
        expensive = False

        def field(self, member: PlannedMember, progress: Callable[[float], None]) -> float:
            return member.parameters["t"]

    members = planned(2, 2)
    assert runs_of(Plain(), members) == [(m,) for m in members]
    assert [d.field for d in dumps_of(Plain(), members, None)] == [m.parameters["t"] for m in members]
