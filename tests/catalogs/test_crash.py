"""A writer that dies at any moment leaves a catalog that reads well and that the next run completes."""

from __future__ import annotations

import os
import random
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from catalogs import cinema, durable
from catalogs.catalog import Catalog, CatalogPlan
from catalogs.check import check
from catalogs.table import JOURNAL, SPARE
from tests.catalogs.conftest import add_member, make_plan

MEMBERS = {"a": 110.0, "b": 150.0, "c": 190.0}
LOSSES = ("before", "within", "after", "contents", "everything")


def small_plan() -> CatalogPlan:
    """Two views are enough: every kind of file and of moment is there."""
    whole = make_plan()
    return make_plan(cameras=whole.cameras[:2], view_splits=whole.view_splits[:2])


def write_all(path: Path, names: tuple[str, ...] = tuple(MEMBERS), stored: Path | None = None) -> None:
    """What a simulation's run does: create or open, then add the members that are not there, noting what is `stored`."""
    catalog = Catalog.create(path, small_plan())
    for seed, (name, reynolds) in enumerate(MEMBERS.items()):
        if name in names and name not in catalog:
            add_member(catalog, name, reynolds, seed=seed)
            if stored is not None:
                stored.write_text(stored.read_text() + name)
    catalog.rebuild_table()


def contents(path: Path) -> dict[str, bytes]:
    """Every file of a catalog, but what is derived and differs in times and inodes."""
    files = (p for p in path.rglob("*") if p.is_file() and p.name not in (JOURNAL, SPARE))
    return {str(p.relative_to(path)): p.read_bytes() for p in files}


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
            catalog.images(member, appearance, threads=1)


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


class MortalDisk:
    """Stands in `durable`'s place at the door to the disk and dies at a chosen operation, with a chosen loss.

    "before", "within" and "after" the operation the process is killed.  A power cut after it takes away, too, what
    was not synced: the "contents" of files, or "everything", new names and renames as well.
    """

    def __init__(self, step: int, loss: str, root: Path) -> None:
        self.count, self.step, self.loss, self.root = 0, step, loss, root
        self.unsynced: set[int] = set()  # files by inode
        self.new_names: dict[int, set[str]] = {}  # by folder's inode
        self.renames: list[tuple[Path, Path, bytes | None]] = []
        self.exchanges: list[tuple[Path, Path]] = []
        self.write, self.append, self.sync = durable.write, durable.append, durable.sync
        self.rename, self.link, self.exchange = durable.rename, durable.link, durable.exchange

    def install(self) -> None:
        durable.SYNCS_AT_ONCE = 1  # so that the operations come in one order
        durable.write, durable.append, durable.sync = self._write, self._append, self._sync
        durable.rename, durable.link, durable.exchange = self._rename, self._link, self._exchange

    def remove(self) -> None:
        durable.SYNCS_AT_ONCE = 16
        durable.write, durable.append, durable.sync = self.write, self.append, self.sync
        durable.rename, durable.link, durable.exchange = self.rename, self.link, self.exchange

    def _write(self, path: Path, data: bytes) -> None:
        def within() -> None:
            self.write(path, data[: len(data) // 2])

        def whole() -> None:
            self.new_names.setdefault(path.parent.stat().st_ino, set()).add(path.name)
            self.write(path, data)
            self.unsynced.add(path.stat().st_ino)

        self._operate(whole, within)

    def _append(self, path: Path, data: bytes) -> None:
        def within() -> None:
            self.append(path, data[: len(data) // 2])

        def whole() -> None:
            if not path.exists():
                self.new_names.setdefault(path.parent.stat().st_ino, set()).add(path.name)
            self.append(path, data)
            self.unsynced.add(path.stat().st_ino)

        self._operate(whole, within)

    def _link(self, source: Path, target: Path) -> None:
        def whole() -> None:
            self.new_names.setdefault(target.parent.stat().st_ino, set()).add(target.name)
            self.link(source, target)

        self._operate(whole, lambda: None)

    def _exchange(self, first: Path, second: Path) -> None:
        def whole() -> None:
            self.exchange(first, second)
            self.exchanges.append((first, second))

        self._operate(whole, lambda: None)

    def _sync(self, path: Path) -> None:
        def whole() -> None:
            self.sync(path)
            node = path.stat().st_ino
            self.unsynced.discard(node)
            self.new_names.pop(node, None)
            self.renames = [rename for rename in self.renames if rename[1].parent != path]
            self.exchanges = [pair for pair in self.exchanges if pair[1].parent != path]

        self._operate(whole, lambda: None)

    def _rename(self, source: Path, target: Path) -> None:
        def whole() -> None:
            self.renames.append((source, target, target.read_bytes() if target.is_file() else None))
            self.rename(source, target)

        self._operate(whole, lambda: None)

    def _operate(self, whole: Callable[[], None], within: Callable[[], None]) -> None:
        self.count += 1
        if self.count != self.step:
            whole()
            return
        if self.loss == "within":
            within()
        elif self.loss != "before":
            whole()
        if self.loss == "everything":
            self._lose_names()
        if self.loss in ("contents", "everything"):
            self._lose_contents()
        os.kill(os.getpid(), signal.SIGKILL)

    def _lose_names(self) -> None:
        for pair in self.exchanges:
            self.exchange(*pair)
        for source, target, replaced in reversed(self.renames):
            os.replace(target, source)
            if replaced is not None:
                target.write_bytes(replaced)
        for folder in [self.root, *(p for p in self.root.rglob("*") if p.is_dir())]:
            for name in self.new_names.get(folder.stat().st_ino, ()):
                (folder / name).unlink(missing_ok=True)

    def _lose_contents(self) -> None:
        for path in self.root.rglob("*"):
            if path.is_file() and path.stat().st_ino in self.unsynced:
                os.truncate(path, path.stat().st_size // 2)


@pytest.fixture
def folder() -> Iterator[Path]:
    """In memory where the system has such a place: these tests sync thousands of times."""
    memory = Path("/dev/shm")
    place = Path(tempfile.mkdtemp(dir=memory if os.access(memory, os.W_OK) else None))
    yield place
    shutil.rmtree(place)


@pytest.fixture
def undisturbed(folder: Path) -> dict[str, bytes]:
    write_all(folder / "whole.cdb")
    assert check(folder / "whole.cdb") == []
    return contents(folder / "whole.cdb")


def operations(folder: Path) -> int:
    """How many operations an undisturbed run has."""
    disk = MortalDisk(-1, "after", folder)
    disk.install()
    try:
        write_all(folder / "count.cdb", ("a", "b"))
    finally:
        disk.remove()
    return disk.count


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
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
def test_killed_at_fifty_random_moments(folder: Path, undisturbed: dict[str, bytes]) -> None:
    started = time.perf_counter()
    write_all(folder / "timing.cdb")
    whole = time.perf_counter() - started
    draw = random.Random(0)
    killed = attempt = 0
    while killed < 50:
        attempt += 1
        assert attempt < 500, "the writer keeps ending before it is killed"
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
