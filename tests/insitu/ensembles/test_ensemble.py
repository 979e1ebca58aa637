"""Many members: nothing is lost when some fail, a worker dies, the disk fills or someone presses Ctrl-C."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import PlannedMember, ViewPlan
from insitu.ensembles.ensemble import pilot_members, run_ensemble
from insitu.members.planning import PlanOptions
from tests.support.executors import AtOnce

PROJECT = Path(__file__).resolve().parents[3]
SPACE = ParameterSpace((Parameter("w", 0.0, 1.0),))
VOLUME = VolumeRendering(
    "dvr", TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.2, 0.0), (1.0, 0.6)), 0.3)
)
OPTIONS = PlanOptions(SPACE, (VOLUME,), ViewPlan(frequency=1, width=16, height=16), sample_distance=0.1)


@dataclass(frozen=True)
class Blob:
    values: np.ndarray
    spacing: tuple[float, float, float] = (0.2, 0.2, 0.2)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time: float = 1.5


def blob(width: float) -> Blob:
    grid = np.meshgrid(*[np.linspace(-1.0, 1.0, 8)] * 3, indexing="ij")
    return Blob(np.exp(-sum(g**2 for g in grid) / (0.1 + width)).astype(np.float32))


class OddError(Exception):
    """An exception that does not survive pickling."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(first)


@dataclass(frozen=True)
class Source:
    """Blobs, with accidents by member name; every call leaves a line in `log`."""

    log: str
    accidents: tuple[tuple[str, str], ...] = ()
    expensive: bool = False

    @property
    def identity(self) -> Mapping[str, Any]:
        return {"kind": "blob"}

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> Blob:
        with open(self.log, "a") as log:
            log.write(member.name + "\n")
        progress(0.5)
        accident = dict(self.accidents).get(member.name, "")
        if accident == "nan":
            return Blob(np.full((8, 8, 8), np.nan))
        if accident == "odd":
            raise OddError("a strange", "error")
        if accident == "full":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if accident == "die" or (accident == "die once" and Path(self.log).read_text().count(member.name) == 1):
            os.kill(os.getpid(), signal.SIGKILL)
        return blob(member.parameters["w"])


def planned(count: int = 5) -> list[PlannedMember]:
    return [PlannedMember(f"m{i}", {"w": i / (count - 1)}, "train") for i in range(count)]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log"
    path.touch()
    return path


def names(path: Path) -> list[str]:
    return [m.name for m in Catalog.open(path).members]


def test_members_that_are_there_are_skipped_and_pilots_computed_once(tmp_path: Path, log: Path) -> None:
    path, cache = tmp_path / "a.cdb", tmp_path / "pilots"
    source = Source(str(log), expensive=True)
    first = run_ensemble(path, planned(), source, OPTIONS, executor=AtOnce(), shard=(1, 2), cache=cache)
    assert names(path) == ["m0", "m2", "m4"]
    assert (len(first.rendered), first.skipped, first.failures) == (3, (), {})
    assert sorted(log.read_text().split()) == ["m0", "m2", "m4"]  # the pilots m0 and m4 were kept
    assert not cache.exists()
    second = run_ensemble(path, planned(), source, OPTIONS, executor=AtOnce(), cache=cache)
    assert second.skipped == ("m0", "m2", "m4")
    assert sorted(log.read_text().split()) == ["m0", "m1", "m2", "m3", "m4"]
    assert check(path) == []
    assert Catalog.open(path).members[0].provenance["time"] == 1.5


def test_shards_share_the_members_out(tmp_path: Path, log: Path) -> None:
    path, source = tmp_path / "a.cdb", Source(str(log))
    for index in (1, 2, 3):
        run_ensemble(path, planned(7), source, OPTIONS, executor=AtOnce(), shard=(index, 3))
    assert names(path) == [f"m{i}" for i in range(7)]
    with pytest.raises(ValueError, match="0/3"):
        run_ensemble(path, planned(7), source, OPTIONS, shard=(0, 3))


@pytest.mark.slow
def test_a_failing_member_is_reported_and_the_others_stay(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "a.cdb"
    source = Source(str(log), (("m1", "nan"), ("m3", "odd"), ("m0", "nan")))
    result = run_ensemble(path, planned(), source, OPTIONS, workers=2)
    assert names(path) == ["m2", "m4"]
    assert set(result.failures) == {"m0", "m1", "m3"}
    assert "NaN" in result.failures["m1"]
    assert "OddError: a strange" in result.failures["m3"]
    assert "3 failed" in repr(result)
    missing = Catalog.open(path).missing
    assert [m.name for m in missing] == ["m0", "m1", "m3"]
    assert missing[1].parameters == planned()[1].parameters
    again = run_ensemble(path, planned(), Source(str(log)), OPTIONS, workers=1)
    assert (len(again.rendered), again.failures) == (3, {})
    assert Catalog.open(path).missing == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parameters": {"b": 1.0}}, "member m2: parameters must be exactly"),
        ({"parameters": {"w": float("nan")}}, "member m2: parameter w must be finite"),
        ({"name": "a/b"}, "member a/b: invalid member name"),
        ({"split": "all"}, "member m2: split must be one of"),
        ({"appearances": ("iso",)}, "member m2: .*iso"),
    ],
)
def test_every_member_is_checked_before_any_field_is_made(
    tmp_path: Path, log: Path, changes: dict[str, Any], message: str
) -> None:
    members = planned()
    members[2] = replace(members[2], **changes)
    for path in (tmp_path / "a.cdb", tmp_path / "a"):
        with pytest.raises(ValueError, match=message if path.suffix else r"ends with \.cdb"):
            run_ensemble(path, members, Source(str(log)), OPTIONS, executor=AtOnce())
    assert log.read_text() == ""
    assert not (tmp_path / "a.cdb").exists()


def test_when_every_pilot_fails_nothing_is_written(tmp_path: Path, log: Path) -> None:
    source = Source(str(log), (("m0", "nan"), ("m4", "nan")), expensive=True)
    with pytest.raises(ValueError, match="NaN"):
        run_ensemble(tmp_path / "a.cdb", planned(), source, OPTIONS, executor=AtOnce(), cache=tmp_path / "kept")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log"]


@pytest.mark.slow
def test_a_worker_that_dies_takes_only_its_own_member_along(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "a.cdb"
    result = run_ensemble(path, planned(), Source(str(log), (("m1", "die"),)), OPTIONS, workers=2)
    assert names(path) == ["m0", "m2", "m3", "m4"]
    assert "killed, twice" in result.failures["m1"]
    assert log.read_text().count("m1") == 2
    assert not list((path / "members").glob(".*"))


@pytest.mark.slow
def test_a_member_whose_worker_died_once_is_rendered_after_all(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "a.cdb"
    result = run_ensemble(path, planned(), Source(str(log), (("m2", "die once"),)), OPTIONS, workers=2)
    assert names(path) == ["m0", "m1", "m2", "m3", "m4"]
    assert not result.failures
    assert log.read_text().count("m2") == 2


@pytest.mark.slow
def test_a_full_disk_stops_the_ensemble_at_once(tmp_path: Path, log: Path) -> None:
    source = Source(str(log), (("m1", "full"),))
    result = run_ensemble(tmp_path / "a.cdb", planned(), source, OPTIONS, workers=1)
    assert names(tmp_path / "a.cdb") == ["m0"]
    assert set(result.failures) == {"m1", "m2", "m3", "m4"}
    _, only = str(result).splitlines()
    assert (
        only == f"  4 members (m1, m2, m3, m4): No space left on device ({tmp_path / 'a.cdb'}): make room or permission"
    )
    assert log.read_text().split()[-1] == "m1"


def test_another_plan_or_other_members_are_refused_with_their_names(tmp_path: Path, log: Path) -> None:
    path, source = tmp_path / "a.cdb", Source(str(log))
    run_ensemble(path, planned(), source, OPTIONS, executor=AtOnce())
    before = {p: p.read_bytes() for p in path.rglob("*") if p.is_file()}
    moved = [PlannedMember("m3", {"w": 0.7}, "train"), PlannedMember("m5", {"w": 0.8}, "train")]
    with pytest.raises(ValueError, match=r"m3 parameters\.w: 0\.7 here, 0\.75 in the catalog"):
        run_ensemble(path, moved, source, OPTIONS, executor=AtOnce())
    other = PlanOptions(SPACE, (VOLUME,), ViewPlan(frequency=1, width=32, height=16), sample_distance=0.1)
    with pytest.raises(ValueError, match="width 32 here, 16 in the catalog"):
        run_ensemble(path, planned(6), source, other, executor=AtOnce())
    assert before == {p: p.read_bytes() for p in path.rglob("*") if p.is_file()}


@dataclass(frozen=True)
class FileSource(Source):
    """Blobs of a file that may change."""

    file: str = "blobs.h5"
    held: tuple[tuple[str, int], ...] = ()
    plan_holds: int = 1

    @property
    def identity(self) -> Mapping[str, Any]:
        return {"kind": "blob", "file": self.file, "contents": {"size": self.plan_holds}}

    def record(self, member: PlannedMember) -> Mapping[str, Any]:
        return {**self.identity, "contents": {"size": dict(self.held).get(member.name, 1)}}

    def is_changed(self, member: PlannedMember, before: Mapping[str, Any]) -> bool:
        return before.get("contents") != self.record(member)["contents"]


def test_shards_of_other_data_or_contents_do_not_mix(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "a.cdb"
    run_ensemble(path, planned(), FileSource(str(log)), OPTIONS, executor=AtOnce(), shard=(1, 2))
    before = {p: p.read_bytes() for p in path.rglob("*") if p.is_file()}
    with pytest.raises(ValueError, match=r'source\.file: "other\.h5" here, "blobs\.h5" in the catalog'):
        run_ensemble(path, planned(), FileSource(str(log), file="other.h5"), OPTIONS, shard=(2, 2))
    changed = FileSource(str(log), held=(("m2", 5), ("m4", 5)))
    with pytest.raises(ValueError, match=r"other contents of the files than they have now, of 2 members \(m2, m4\)"):
        run_ensemble(path, planned(), changed, OPTIONS, shard=(2, 2))
    assert before == {p: p.read_bytes() for p in path.rglob("*") if p.is_file()}
    run_ensemble(path, planned(), changed, OPTIONS, executor=AtOnce(), existing="skip")
    assert names(path) == [f"m{i}" for i in range(5)]


def test_a_catalog_of_before_sources_were_kept_goes_on(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "a.cdb"
    run_ensemble(path, planned(), FileSource(str(log)), OPTIONS, executor=AtOnce(), shard=(1, 2))
    for record in (path / "catalog.json", path / "members" / "m0" / "member.json"):
        told = json.loads(record.read_text())
        del told["provenance"]["source"]
        told.pop("digest", None)  # as in catalogs of that time
        record.write_text(json.dumps(told))
    source = StoredBefore(str(log))
    assert len(run_ensemble(path, planned(), source, OPTIONS, executor=AtOnce()).rendered) == 2


@dataclass(frozen=True)
class StoredBefore(FileSource):
    """Which takes a member without a record for unchanged, as every reader does."""

    def is_changed(self, member: PlannedMember, before: Mapping[str, Any]) -> bool:
        return "contents" in before and super().is_changed(member, before)


def test_what_a_killed_run_left_is_completed(tmp_path: Path, log: Path) -> None:
    path, source = tmp_path / "a.cdb", Source(str(log))
    path.mkdir()
    (path / ".lock").touch()  # killed while the catalog was made
    run_ensemble(path, planned(), source, OPTIONS, executor=AtOnce())
    table = (path / "data.csv").read_bytes()
    (path / "data.csv").write_bytes(table[: table.rindex(b"m4")])  # killed before the last member's rows came in
    assert run_ensemble(path, planned(), source, OPTIONS).rendered == ()
    assert (path / "data.csv").read_bytes() == table


def test_out_of_bounds_is_said_here_not_in_the_worker(tmp_path: Path, log: Path) -> None:
    members = [*planned(2), PlannedMember("far", {"w": 1.5}, "test")]
    with pytest.warns(UserWarning, match=r"far: parameter w = 1\.5 lies outside"):
        result = run_ensemble(tmp_path / "a.cdb", members, Source(str(log)), OPTIONS, executor=AtOnce())
    assert len(result.rendered) == 3


def test_warnings_may_be_taken_by_the_caller(tmp_path: Path, log: Path) -> None:
    members = [*planned(2), PlannedMember("far", {"w": 1.5}, "test")]
    told: list[Warning] = []
    run_ensemble(tmp_path / "a.cdb", members, Source(str(log)), OPTIONS, executor=AtOnce(), warn=told.append)
    assert [str(note).split(" lies")[0] for note in told] == ["far: parameter w = 1.5"]


@pytest.mark.slow
def test_progress_counts_members_and_images(tmp_path: Path, log: Path) -> None:
    states = []
    run_ensemble(tmp_path / "a.cdb", planned(), Source(str(log)), OPTIONS, workers=2, progress=states.append)
    assert (states[-1].members_done, states[-1].images_done) == (5, 60)
    assert (states[-1].members, states[-1].images) == (5, 60)
    assert [s.members_done for s in states] == sorted(s.members_done for s in states)


def test_pilots_lie_far_apart_and_are_training_members() -> None:
    space = ParameterSpace((Parameter("a", 0.0, 10.0), Parameter("b", 0.0, 1.0)))
    random = np.random.default_rng(3).random((30, 2)) * [10.0, 1.0]
    corners = [(0.0, 0.0), (10.0, 1.0), (10.0, 0.0)]
    rows = [*((*r, "train") for r in random * 0.9 + [0.5, 0.05]), *((*c, "train") for c in corners), (0.0, 1.0, "test")]
    members = [PlannedMember(str(i), {"a": a, "b": b}, split) for i, (a, b, split) in enumerate(rows)]
    assert [tuple(m.parameters.values()) for m in pilot_members(members, space, 3)] == corners[:2] + corners[2:]
    assert len(pilot_members(members[:1], space, 3)) == 1


SLOW_ENSEMBLE = """
    import sys, time
    from dataclasses import dataclass
    from pathlib import Path
    sys.path[:0] = [{project!r}, {tests!r}]
    from test_ensemble import SPACE, VOLUME, Source, planned
    from catalogs.vocabulary.scene import ViewPlan
    from insitu.ensembles.ensemble import run_ensemble
    from insitu.members.planning import PlanOptions

    if __name__ == "__main__":
        options = PlanOptions(SPACE, (VOLUME,), ViewPlan(frequency=2, width=64, height=64), sample_distance=0.002)
        run_ensemble(Path({path!r}), planned(40), Source({log!r}), options, workers=2)
"""


@pytest.mark.slow
@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGKILL])
def test_interrupted_it_leaves_no_process_and_goes_on(tmp_path: Path, log: Path, signal_number: int) -> None:
    path = tmp_path / "a.cdb"
    script = tmp_path / "run.py"
    settings = {"project": str(PROJECT), "tests": str(Path(__file__).parent), "path": str(path), "log": str(log)}
    script.write_text(textwrap.dedent(SLOW_ENSEMBLE).format(**settings))
    process = subprocess.Popen([sys.executable, str(script)], start_new_session=True, stderr=subprocess.PIPE)
    until = time.monotonic() + 200
    while time.monotonic() < until and not list(path.glob(".unfinished/*/dvr/*.png")):
        assert process.poll() is None, process.stderr
        time.sleep(0.02)
    workers = psutil.Process(process.pid).children(recursive=True)
    assert len(workers) >= 2
    if signal_number == signal.SIGKILL:
        process.kill()  # the parent only: nobody tells the workers
    else:
        os.killpg(process.pid, signal_number)
    process.communicate(timeout=100)
    assert process.returncode != 0
    assert not psutil.wait_procs(workers, timeout=100)[1]
    partial = list(path.glob(".unfinished/*"))
    assert signal_number == signal.SIGKILL or not partial
    some = len(names(path))
    todo = planned(40)[: some + 2]
    options = PlanOptions(SPACE, (VOLUME,), ViewPlan(frequency=2, width=64, height=64), sample_distance=0.002)
    run_ensemble(path, todo, Source(str(log)), options, executor=AtOnce())
    assert not list(path.glob(".unfinished/*"))
    assert check(path) == []
