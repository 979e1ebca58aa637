"""A writer that is killed at any moment leaves a catalog that reads well and that the next run completes."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from catalogs import cinema, durable
from catalogs.catalog import Catalog, CatalogPlan
from tests.catalogs.conftest import add_member, make_plan

MEMBERS = {"a": 110.0, "b": 150.0, "c": 190.0}
OPERATIONS = ("write", "sync", "rename")


def small_plan() -> CatalogPlan:
    """Three views are enough: every kind of file and of moment is there."""
    whole = make_plan()
    return make_plan(cameras=whole.cameras[:3], view_splits=whole.view_splits[:3])


def write_all(path: Path) -> None:
    """What a simulation's run does: create or open, then add the members that are not there."""
    catalog = Catalog.create(path, small_plan())
    for seed, (name, reynolds) in enumerate(MEMBERS.items()):
        if name not in catalog:
            add_member(catalog, name, reynolds, seed=seed)
    catalog.rebuild_table()


def contents(path: Path) -> dict[str, bytes]:
    """Every file of a finished catalog."""
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}


def in_child(work: Callable[[], None]) -> tuple[int, Callable[[], int]]:
    """Start `work` in a forked child; returns its process number and what waits for its status."""
    child = os.fork()
    if child == 0:
        try:
            work()
        except BaseException:
            os._exit(3)
        os._exit(0)
    return child, lambda: os.waitpid(child, 0)[1]


def check_consistent(path: Path) -> None:
    """Whatever a reader sees now must be whole: each row's image, each member."""
    if not (path / "catalog.json").is_file():
        return
    catalog = Catalog.open(path)
    header, rows = cinema.parse((path / "data.csv").read_bytes().decode())
    assert cinema.header_problems(header) == []
    assert not rows or cinema.column_problems(header, rows) == []
    assert all((path / row[-1]).is_file() for row in rows)
    for member in catalog.members:
        assert member.summary() is not None
        for appearance in catalog.appearance_names:
            catalog.images(member, appearance, range(3), threads=1)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    path = tmp_path_factory.mktemp("whole") / "run.cdb"
    write_all(path)
    return contents(path)


def dying_at(step: int, patched: Callable[[str, Any], None]) -> list[int]:
    """Patch the door to the disk so that the process kills itself at its `step`-th moment, before or after an operation."""
    count = [0]

    def moment() -> None:
        count[0] += 1
        if count[0] == step:
            os.kill(os.getpid(), signal.SIGKILL)

    for name in OPERATIONS:
        operation = getattr(durable, name)

        def guarded(*arguments: Any, operation: Any = operation) -> None:
            moment()
            operation(*arguments)
            moment()

        patched(name, guarded)
    return count


def moments(tmp_path: Path) -> int:
    """How many moments an undisturbed run has."""
    original = {name: getattr(durable, name) for name in OPERATIONS}
    try:
        count = dying_at(-1, lambda name, value: setattr(durable, name, value))
        write_all(tmp_path / "count.cdb")
    finally:
        for name, value in original.items():
            setattr(durable, name, value)
    return count[0]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_killed_before_and_after_every_operation(
    tmp_path: Path, undisturbed: dict[str, bytes], monkeypatch: Any
) -> None:
    monkeypatch.setattr(durable, "SYNCS_AT_ONCE", 1)  # so that the moments come in one order
    total = moments(tmp_path)
    assert total > 100
    for step in range(1, total + 1):
        path = tmp_path / f"{step}.cdb"

        def work(path: Path = path, step: int = step) -> None:
            dying_at(step, lambda name, value: setattr(durable, name, value))
            write_all(path)

        _, wait = in_child(work)
        assert os.WTERMSIG(wait()) == signal.SIGKILL
        check_consistent(path)
        write_all(path)
        assert contents(path) == undisturbed, f"killed at moment {step} of {total}"


def test_killed_at_fifty_random_moments(tmp_path: Path, undisturbed: dict[str, bytes]) -> None:
    started = time.perf_counter()
    write_all(tmp_path / "timing.cdb")
    whole = time.perf_counter() - started
    draw = random.Random(0)
    killed = attempt = 0
    while killed < 50:
        attempt += 1
        assert attempt < 500, "the writer keeps ending before it is killed"
        path = tmp_path / f"{attempt}.cdb"
        child, wait = in_child(lambda path=path: write_all(path))
        time.sleep(draw.uniform(0.0, whole))
        os.kill(child, signal.SIGKILL)
        killed += os.WIFSIGNALED(wait())
        check_consistent(path)
        write_all(path)
        assert contents(path) == undisturbed, f"attempt {attempt}"


def test_two_writers_at_once_lose_nothing(tmp_path: Path, undisturbed: dict[str, bytes]) -> None:
    path = tmp_path / "shared.cdb"
    Catalog.create(path, small_plan())

    def add(seed: int, name: str) -> None:
        add_member(Catalog.open(path), name, MEMBERS[name], seed=seed)

    waits = [in_child(lambda s=s, n=n: add(s, n))[1] for s, n in enumerate(MEMBERS)]
    assert [wait() for wait in waits] == [0, 0, 0]
    assert contents(path) == undisturbed


def test_the_leavings_of_the_living_are_kept(tmp_path: Path) -> None:
    catalog = Catalog.create(tmp_path / "a.cdb", small_plan())
    writer = catalog.begin_member("slow", {"Re": 150.0, "Pr": 1.0})
    add_member(catalog, "quick", 160.0)
    assert writer.path.is_dir()
    with pytest.raises(RuntimeError), writer:
        raise RuntimeError("interrupted")
    assert not writer.path.exists()
