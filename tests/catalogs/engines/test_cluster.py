"""Tasks on a real scheduler and real worker processes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from catalogs.engines.address import opened
from catalogs.engines.cluster import Cluster
from catalogs.engines.engine import EngineError
from tests.support import dask_tasks
from tests.support.local_cluster import SETTINGS, LocalCluster, local_cluster

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not find_spec("distributed"), reason="Dask is not installed: pip install gs-surrogate[dask]"),
]


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalCluster]:
    with local_cluster(tmp_path_factory.mktemp("dask"), workers=1) as cluster:
        yield cluster


def outcomes(engine: Cluster, tasks: dict[str, Any], **more: Any) -> tuple[dict[str, Any], dict[str, BaseException]]:
    done: dict[str, Any] = {}
    failed: dict[str, BaseException] = {}
    engine.run(tasks, done.__setitem__, failed.__setitem__, lambda reports: None, **more)
    return done, failed


def test_each_task_ends_once_with_its_result_or_its_own_error(workers: LocalCluster) -> None:
    tasks: dict[str, Any] = {str(i): partial(dask_tasks.square, i) for i in range(20)}
    tasks |= {"bad": partial(dask_tasks.refuse, "no such thing"), "where": dask_tasks.surroundings}
    with opened(workers.address) as engine:
        done, failed = outcomes(engine, tasks)
    assert done.pop("where") == (os.getcwd(), "0")
    assert done == {str(i): i * i for i in range(20)}
    assert [(name, type(e), str(e)) for name, e in failed.items()] == [("bad", ValueError, "no such thing")]


def test_after_a_hopeless_error_the_rest_fails_with_it(workers: LocalCluster, tmp_path: Path) -> None:
    tasks: dict[str, Any] = {"bad": partial(dask_tasks.refuse, "disk full")}
    tasks |= {str(i): partial(dask_tasks.noted, tmp_path, str(i), 0.2) for i in range(30)}
    with opened(workers.address) as engine:
        done, failed = outcomes(engine, tasks, give_up=lambda error: "disk" in str(error))
    assert len(done) + len(failed) == 31
    assert {str(error) for error in failed.values()} == {"disk full"}
    assert len(list(tmp_path.iterdir())) < 30


def test_interrupted_it_begins_nothing_more(workers: LocalCluster, tmp_path: Path) -> None:
    tasks = {str(i): partial(dask_tasks.noted, tmp_path, str(i), 0.3) for i in range(40)}

    def interrupt(reports: Iterable[Any]) -> None:
        if list(tmp_path.iterdir()):
            raise KeyboardInterrupt

    with opened(workers.address) as engine:
        with pytest.raises(KeyboardInterrupt):
            engine.run(tasks, lambda *_: None, lambda *_: None, interrupt)
        done, _ = outcomes(engine, {"next": partial(dask_tasks.square, 3)})  # waits for none of the forty
    assert done == {"next": 9}
    assert len(list(tmp_path.iterdir())) < 40


def test_a_task_that_kills_every_worker_fails_in_plain_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SETTINGS, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")
    with local_cluster(tmp_path, workers=1) as own, opened(own.address) as engine:
        _, failed = outcomes(engine, {"one": dask_tasks.die})
    assert "each worker that tried it died" in str(failed["one"])


def test_a_scheduler_that_is_lost_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("catalogs.engines.cluster.CONNECT_SECONDS", 5.0)
    with local_cluster(tmp_path, workers=1) as own, opened(own.address) as engine:

        def kill(reports: Iterable[Any]) -> None:
            own.scheduler.kill()

        with pytest.raises(EngineError, match="is gone; finished results remain"):
            engine.run({"a": partial(dask_tasks.noted, tmp_path, "a", 60.0)}, lambda *_: None, lambda *_: None, kill)


def test_workers_that_are_not_fit_are_named_with_the_remedy(tmp_path: Path) -> None:
    with local_cluster(tmp_path, workers=0) as own:
        own.add_worker("--nthreads", "2")
        with pytest.raises(EngineError, match=r"worker tcp://127.0.0.1:\d+ has 2 threads: start it with --nthreads 1"):
            opened(own.address).__enter__()


def test_a_worker_that_joins_later_is_asked_too(tmp_path: Path) -> None:
    with local_cluster(tmp_path, workers=1) as own, opened(own.address) as engine:
        own.add_worker("--nthreads", "2")
        engine.client.wait_for_workers(2, timeout=100)
        own.kill(own.workers[0])
        _, failed = outcomes(engine, {"one": partial(dask_tasks.square, 1)})
    assert "has 2 threads" in str(failed["one"])


def test_who_waits_for_a_worker_says_so_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("catalogs.engines.cluster.QUIET_SECONDS", 0.5)
    monkeypatch.setattr("catalogs.engines.cluster.LOOK_SECONDS", 0.1)
    said: list[str] = []
    with local_cluster(tmp_path, workers=0) as own:

        def hear(text: str) -> None:
            said.append(text)
            if "has no worker" in text:
                own.add_worker()

        with opened(own.address, say=hear) as engine:
            assert len(said) == 2
            own.kill(own.workers[0])
            done, _ = outcomes(engine, {"one": partial(dask_tasks.noted, tmp_path, "one", 2.0)})
    assert done == {"one": "one"}
    scheduler = own.address.replace("dask://", "tcp://")
    waits = (
        f"the Dask scheduler at {scheduler} has no worker{{}}: start some with `dask worker {scheduler} --nthreads 1 "
    )
    assert said[0].startswith(waits.format(", and it waits for one"))
    assert said[2].startswith(waits.format(", for which 1 tasks wait"))
    assert said[1] == said[3] == "a worker has come: it goes on"


def test_interrupted_it_stops_the_tasks_that_ask_and_says_which(workers: LocalCluster, tmp_path: Path) -> None:
    said: list[str] = []
    tasks = {f"task {i}": partial(dask_tasks.until_stopped, tmp_path, str(i)) for i in range(5)}

    def interrupt(reports: Iterable[Any]) -> None:
        if list(tmp_path.iterdir()):
            raise KeyboardInterrupt

    with opened(workers.address, say=said.append) as engine, pytest.raises(KeyboardInterrupt):
        engine.run(tasks, lambda *_: None, lambda *_: None, interrupt)
    with opened(workers.address) as engine:
        assert outcomes(engine, {"next": partial(dask_tasks.square, 3)})[0] == {"next": 9}
    begun, stopped = sorted(path.name for path in tmp_path.iterdir())
    assert stopped == f"{begun}.stopped"
    assert said == [f"stopping task {begun} at the next safe point; 4 queued tasks cancelled"]


def test_a_file_that_a_worker_does_not_see_is_named(workers: LocalCluster, tmp_path: Path) -> None:
    with pytest.raises(EngineError, match=r"does not see .*/catalog\.json: it must be on a file system that all"):
        opened(workers.address, files=[tmp_path / "catalog.json"]).__enter__()


def test_no_scheduler_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("catalogs.engines.cluster.CONNECT_SECONDS", 1.0)
    with pytest.raises(EngineError, match=r"no Dask scheduler answers at tcp://127.0.0.1:9 .*start one there"):
        opened("dask://127.0.0.1:9").__enter__()
