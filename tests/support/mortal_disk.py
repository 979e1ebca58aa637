"""Writers that die at a chosen operation of the disk, and what catalogs must look like then."""

from __future__ import annotations

import os
import signal
import traceback
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import wraps
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

from catalogs.files import cinema, durable
from catalogs.store.catalog import Catalog
from catalogs.store.table import JOURNAL, SPARE

LOSSES = ("before", "within", "after", "contents", "everything")
IN_TURN = "in turn"  # each of the others at every fourth operation


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
            traceback.print_exc()
            os._exit(3)
        os._exit(0)
    return child, lambda: os.waitpid(child, 0)[1]


def in_small_process(test: Callable[[Path, str], None]) -> Callable[[Path, str], None]:
    """A test of a folder and a loss in a fresh process: to fork one that has loaded every library takes 30 ms of a core."""

    @wraps(test)
    def run(folder: Path, loss: str) -> None:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            pool.submit(_run_here, test.__module__, test.__name__, folder, loss).result()

    return run


def _run_here(module: str, name: str, folder: Path, loss: str) -> None:
    getattr(import_module(module), name).__wrapped__(folder, loss)


class MortalDisk:
    """Stands in `durable`'s place at the door to the disk and dies at a chosen operation, with a chosen loss.

    "before", "within" and "after" the operation the process is killed.  A power cut after it takes away, too, what
    was not synced: the "contents" of files, or "everything", new names and renames as well.
    """

    def __init__(self, step: int, loss: str, root: Path) -> None:
        loss = LOSSES[step % 4] if loss == IN_TURN else loss
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
