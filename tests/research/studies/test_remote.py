"""Studies whose trainings the workers of a real cluster make."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from catalogs.engines.address import opened
from catalogs.engines.engine import Task
from native.threads import cores
from research.studies.__main__ import main
from research.studies.ablation.experiments import BaseExperiment
from research.studies.ablation.study import AblationStudy
from research.studies.baselines.method import Plan
from research.studies.comparison.contestants import OurSurrogate, Published
from research.studies.comparison.result import AS_PUBLISHED, TRIVIAL, ComparisonResult
from research.studies.comparison.study import ComparisonStudy
from research.studies.comparison.task import ComparisonTask
from research.studies.progress import StudyProgress
from research.studies.remote import OnOneCore, train_on
from research.studies.repeats.run import repeat
from research.studies.repeats.seeds import Scores
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import CHECKPOINT
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget
from surrogate.training.run import train
from tests.research.support.mean_pictures import mean_method
from tests.support.blobs import Blobs
from tests.support.interruptions import outcome
from tests.support.local_cluster import LocalCluster, local_cluster

SCENE = TrainingSettings(gaussians=30, canonical_steps=8, deformation_steps=12, validation_interval=10, seed=4)
MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.25), ("test", 0.5))
MakeCatalog = Callable[..., Any]


class InTurn:
    """An engine that runs one task after the other, here."""

    def run(self, tasks: dict[str, Task], done: Any, failed: Any, tick: Any, give_up: Any = None) -> None:
        for name, task in tasks.items():
            try:
                result = task()
            except Exception as error:
                failed(name, error)
            else:
                done(name, result)
            tick(())


def refuse() -> int:
    raise ValueError("no such thing")


def test_all_end_before_those_that_failed_are_named() -> None:
    done, seen = list[int](), list[StudyProgress]()
    with pytest.raises(RuntimeError, match=r"1 of 3 trainings failed.* again: b: ValueError: no such thing"):
        train_on(InTurn(), {"a": lambda: 1, "b": refuse, "c": lambda: 3}, done.append, seen.append)
    assert done == [1, 3]
    assert [(progress.number, progress.count) for progress in seen] == [(1, 3), (2, 3), (3, 3)]
    assert "on the cluster (3 / 3)" in str(seen[-1])


def test_a_training_on_a_worker_takes_one_core() -> None:
    before = cores()
    assert OnOneCore(cores)() == 1
    assert cores() == before


@pytest.fixture
def pictures(make_catalog: MakeCatalog) -> ComparisonTask:
    return ComparisonTask.of(make_catalog(Blobs(count=3, size=16), members=MEMBERS))


def test_who_takes_the_steps_of_another_is_trained_after_it(pictures: ComparisonTask, tmp_path: Path) -> None:
    first = Published(replace(mean_method("first"), official_steps=25))
    second = OurSurrogate("second", "", "", {"fit_to_need": False, "color_degree": 0}, steps_of="first")
    told = list[ComparisonResult]()
    folders = tmp_path / "comparison", tmp_path / "records" / "blobs", tmp_path / "records"
    study = ComparisonStudy(pictures, *folders, [second, first], [AS_PUBLISHED], 1, Plan(1))
    study.run(tell=told.append, engine=InTurn())
    assert [(result.method, result.error) for result in told] == [(TRIVIAL, ""), ("first", ""), ("second", "")]
    assert told[1].steps == told[2].steps == 25


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalCluster]:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install gs-surrogate[dask]")
    with local_cluster(tmp_path_factory.mktemp("dask"), workers=1) as cluster:
        yield cluster


@pytest.fixture
def run(make_catalog: MakeCatalog, tmp_path: Path) -> Path:
    """A run's folder, with nothing trained."""
    catalog = make_catalog(Blobs(count=3, size=16), members=MEMBERS)
    return begin(catalog.path, tmp_path / "run", TrainingOptions(Budget(steps=40), settings={"gaussians": 30})).folder


def invoked(*words: str) -> str:
    result = CliRunner().invoke(main, list(words), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.slow
def test_repeats_are_trained_on_a_cluster_once_and_score_as_here(
    workers: LocalCluster, run: Path, tmp_path: Path
) -> None:
    asked = ["repeat", str(run), "--seeds", "2"]
    made = invoked(*asked, "--engine", workers.address)
    again = invoked(*asked, "--engine", workers.address)
    here = invoked(*asked, "--records", str(tmp_path / "elsewhere"))
    assert made.count("trained in") == 2
    assert again.count("trained in") == 0
    assert here.count("trained in") == 2  # scores the same models
    for seed in (0, 1):
        kept = [
            json.loads(path.read_text())["values"]["cells"] for path in sorted(tmp_path.rglob(f"seeds/{seed}.json"))
        ]
        assert len(kept) == 2
        assert kept[0] == kept[1]


@pytest.mark.slow
def test_ablations_and_comparisons_are_made_on_a_cluster_once(workers: LocalCluster, run: Path) -> None:
    ablating = ["ablate", str(run), "--seconds", "0.5", "--seeds", "1", "--only", "joint", "--engine", workers.address]
    comparing = ["compare", str(run), "--methods", "insitunet", "--minutes", "0.01", "--engine", workers.address]
    assert invoked(*ablating).count("seed 0:") == 2
    assert invoked(*ablating).count("seed 0:") == 0
    assert "insitunet" in invoked(*comparing)
    assert "insitunet" not in invoked(*comparing)


@pytest.mark.parametrize("words", [["repeat"], ["ablate"], ["compare"]])
def test_what_is_no_address_is_told_before_anything_is_written(run: Path, words: list[str]) -> None:
    before = sorted(run.rglob("*"))
    result = CliRunner().invoke(main, [*words, str(run), "--engine", "slurm"])
    assert result.exit_code != 0
    assert "takes dask://HOST:PORT" in result.output
    assert sorted(run.rglob("*")) == before


def test_a_time_to_stop_is_of_this_machine(run: Path) -> None:
    result = CliRunner().invoke(main, ["compare", str(run), "--engine", "dask://h:1", "--stop-after", "3"])
    assert "--stop-after is for this machine" in result.output


@pytest.mark.slow
def test_a_training_whose_worker_is_killed_goes_on_on_another_one(make_catalog: MakeCatalog, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install gs-surrogate[dask]")
    catalog = make_catalog(Blobs(count=3, size=16), members=MEMBERS)
    settings = SCENE.changed(deformation_steps=150, checkpoint_seconds=0.02, fit_to_need=False, color_degree=0)
    told, killed = list[Scores](), list[float]()
    with local_cluster(tmp_path, workers=1) as own, opened(own.address, [tmp_path]) as engine:

        def kill(_: StudyProgress) -> None:
            if not killed and (tmp_path / "run" / "surrogate" / CHECKPOINT).exists():
                killed.append(time.monotonic())
                own.kill(own.workers[0])
                own.add_worker()

        found = repeat(settings, catalog, tmp_path / "run", seeds=2, engine=engine, progress=kill, tell=told.append)
    assert len(killed) == 1
    assert sorted(scores.seed for scores in told) == [scores.seed for scores in found] == [4, 5]
    train(settings, catalog, tmp_path / "undisturbed")
    assert outcome(tmp_path / "run" / "surrogate") == outcome(tmp_path / "undisturbed")


@pytest.mark.slow
def test_an_ablation_is_as_here(make_catalog: MakeCatalog, tmp_path: Path) -> None:
    catalog = make_catalog(Blobs(count=3, size=16), members=MEMBERS)
    told = list[Any]()
    study = AblationStudy(BaseExperiment(SCENE, catalog), tmp_path, seconds=0.3, seeds=1, only=["joint"])
    study.run(engine=InTurn(), tell=told.append)
    assert len(told) == len(study.variants)
    study.run(engine=InTurn(), tell=partial(pytest.fail, "made again"))


@pytest.mark.slow
def test_a_training_on_a_cluster_that_is_interrupted_stops_after_a_checkpoint(
    workers: LocalCluster, make_catalog: MakeCatalog, tmp_path: Path
) -> None:
    catalog = make_catalog(Blobs(count=3, size=16), members=MEMBERS)
    long = SCENE.changed(deformation_steps=100_000, checkpoint_seconds=0.2)
    checkpoint = tmp_path / "run" / CHECKPOINT

    def interrupt(reports: Any) -> None:
        if checkpoint.is_file():
            raise KeyboardInterrupt

    tasks = {"long": partial(train, long, catalog, tmp_path / "run")}
    with opened(workers.address) as engine, pytest.raises(KeyboardInterrupt):
        engine.run(tasks, lambda *_: None, lambda *_: None, interrupt)
    with opened(workers.address) as engine:  # whose only worker trained
        train_on(engine, {"next": partial(abs, -3)}, lambda result: None)
    stopped = checkpoint.read_bytes()
    time.sleep(0.5)
    assert checkpoint.read_bytes() == stopped
