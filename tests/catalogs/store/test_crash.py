"""A writer that dies at any moment leaves a catalog that reads well and that the next run completes."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from catalogs.files import durable
from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from tests.catalogs.conftest import add_member, small_plan
from tests.support.mortal_disk import LOSSES, MortalDisk, check_consistent, contents, in_child, in_small_process

MEMBERS = {"a": 110.0, "b": 150.0, "c": 190.0}


def write_all(path: Path, names: tuple[str, ...] = tuple(MEMBERS), stored: Path | None = None) -> None:
    """A simulation's run: create or open, then add the missing members, noting those that are `stored`."""
    catalog = Catalog.create(path, small_plan())
    for seed, (name, reynolds) in enumerate(MEMBERS.items()):
        if name in names and name not in catalog:
            add_member(catalog, name, reynolds, seed=seed)
            if stored is not None:
                stored.write_text(stored.read_text() + name)
    catalog.rebuild_table()


@pytest.fixture
def undisturbed(folder: Path) -> dict[str, bytes]:
    write_all(folder / "whole.cdb")
    assert check(folder / "whole.cdb") == []
    return contents(folder / "whole.cdb")


def operations(folder: Path) -> int:
    """The number of operations in an undisturbed run."""
    disk = MortalDisk(-1, "after", folder)
    disk.install()
    try:
        write_all(folder / "count.cdb", ("a", "b"))
    finally:
        disk.remove()
    return disk.count


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
@in_small_process
def test_dead_at_every_operation(folder: Path, loss: str) -> None:
    write_all(folder / "whole.cdb", ("a", "b"))
    undisturbed = contents(folder / "whole.cdb")
    total = operations(folder)
    assert total > 50
    for step in range(1, total + 1):
        path, stored = folder / f"{step}.cdb", folder / "stored"
        stored.write_text("")

        def work(path: Path = path, step: int = step, stored: Path = stored) -> None:
            MortalDisk(step, loss, path).install()
            write_all(path, ("a", "b"), stored)

        assert os.WTERMSIG(in_child(work)[1]()) == signal.SIGKILL, f"{step} of {total}"
        check_consistent(path)
        assert all(name in Catalog.open(path) for name in stored.read_text())
        write_all(path, ("a", "b"))
        assert contents(path) == undisturbed, f"{loss} operation {step} of {total}"
        shutil.rmtree(path)


@pytest.mark.slow
def test_killed_at_random_moments(folder: Path, undisturbed: dict[str, bytes]) -> None:
    started = time.perf_counter()
    write_all(folder / "timing.cdb")
    whole = time.perf_counter() - started
    draw = random.Random(0)
    killed = attempt = 0
    while killed < 20:
        attempt += 1
        assert attempt < 200, "the writer keeps ending before it is killed"
        path = folder / f"{attempt}.cdb"
        child, wait = in_child(lambda path=path: write_all(path))
        time.sleep(draw.uniform(0.0, whole))
        os.kill(child, signal.SIGKILL)
        killed += os.WIFSIGNALED(wait())
        check_consistent(path)
        write_all(path)
        assert contents(path) == undisturbed, f"attempt {attempt}"


def test_a_reader_sees_a_whole_catalog_at_any_time(folder: Path) -> None:
    path = folder / "watched.cdb"
    _, wait = in_child(lambda: write_all(path))
    looks = 0
    while not (path / "members/c").is_dir():
        check_consistent(path)
        looks += 1
    assert wait() == 0
    assert looks > 3
    assert check(path) == []


def test_writers_at_once_lose_nothing(folder: Path, undisturbed: dict[str, bytes]) -> None:
    path = folder / "shared.cdb"
    waits = [in_child(lambda name=name: write_all(path, (name,)))[1] for name in MEMBERS]
    assert [wait() for wait in waits] == [0, 0, 0]
    assert contents(path) == undisturbed


@pytest.mark.parametrize("step", [*range(1, 12), 1000])
def test_a_catalog_that_another_process_makes_meanwhile_is_opened(
    folder: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    """The other one has come as far as operation `step`, or to the end, when this process lists the files."""
    path, listed = folder / "shared.cdb", Path.iterdir
    path.mkdir()

    def make() -> None:
        MortalDisk(step, "before", path).install()
        Catalog.create(path, small_plan())

    def list_late(place: Path) -> Iterator[Path]:
        monkeypatch.undo()
        in_child(make)[1]()
        return listed(place)

    monkeypatch.setattr(Path, "iterdir", list_late)
    add_member(Catalog.create(path, small_plan()), "a", 110.0)
    assert check(path) == []


@pytest.mark.slow
def test_writers_at_once_survive_the_death_of_some(folder: Path, undisturbed: dict[str, bytes]) -> None:
    draw = random.Random(1)
    for attempt in range(10):
        path = folder / f"{attempt}.cdb"
        children = [in_child(lambda path=path, name=name: write_all(path, (name,))) for name in MEMBERS]
        time.sleep(draw.uniform(0.0, 0.05))
        for child, _ in children[:2]:
            os.kill(child, signal.SIGKILL)
        statuses = [wait() for _, wait in children]
        assert statuses[2] == 0
        check_consistent(path)
        assert "c" in Catalog.open(path)
        write_all(path)
        assert contents(path) == undisturbed


def test_one_of_two_that_write_the_same_member_is_told(folder: Path) -> None:
    catalog = Catalog.create(folder / "a.cdb", small_plan())
    slow = catalog.begin_member("a", {"Re": 110.0, "Pr": 1.0})
    add_member(catalog, "a", 110.0)
    before = contents(catalog.path)
    for appearance in catalog.appearance_names:
        for view in range(2):
            slow.write_image(appearance, view, catalog.image("a", appearance, view))
    with pytest.raises(ValueError, match="already"):
        slow.__exit__(None)
    assert contents(catalog.path) == before
    assert catalog.unfinished() == []


def test_the_leavings_of_the_living_are_kept(folder: Path) -> None:
    catalog = Catalog.create(folder / "a.cdb", small_plan())
    writer = catalog.begin_member("slow", {"Re": 150.0, "Pr": 1.0})
    add_member(catalog, "quick", 160.0)
    assert catalog.unfinished() == [writer.path]
    with pytest.raises(KeyboardInterrupt), writer:
        raise KeyboardInterrupt
    assert catalog.unfinished() == []


def test_without_syncs_a_power_cut_would_be_noticed(folder: Path) -> None:
    """The tests above can fail: a writer that forgets to sync loses a member that it had reported as stored."""

    def work() -> None:
        disk = MortalDisk(operations_of_one, "everything", folder / "careless.cdb")
        disk.install()
        durable.sync_tree = lambda _: None
        write_all(folder / "careless.cdb", ("a",))

    def count() -> int:
        disk = MortalDisk(-1, "after", folder)
        disk.install()
        kept, durable.sync_tree = durable.sync_tree, lambda _: None
        try:
            write_all(folder / "count.cdb", ("a",))
        finally:
            disk.remove()
            durable.sync_tree = kept
        return disk.count

    operations_of_one = count()
    assert os.WTERMSIG(in_child(work)[1]()) == signal.SIGKILL
    try:
        check_consistent(folder / "careless.cdb")
        whole = "a" in Catalog.open(folder / "careless.cdb")
    except (ValueError, AssertionError):
        whole = False
    assert not whole
