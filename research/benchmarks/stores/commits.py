"""Cost of adding a member to a catalog that has many: milliseconds per member, which must not grow.

    python -m research.benchmarks.stores.commits [--members 10,1000,10000] [--folder DIR]
    python -m research.benchmarks.stores.commits --kills 200

Every member is one 8x8 image, written and committed by one process (images and their folder are synced, too). The
medians are over the 100 members before each of the given numbers. 10,000 members take some minutes, most of it the
disk's.

With `--kills`, eight processes write into one catalog instead. One of them is killed again and again, at random
moments, and replaced. The table must always be whole. At the end every member that was reported as stored must be
there, whole, once, and in the table.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import statistics
import tempfile
import time
import traceback
from pathlib import Path

import click
import numpy as np

from catalogs.files import cinema
from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import orbit
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from research.benchmarks.timing import digits

WINDOW = 100
WRITERS = 8
LIFE = 10**6  # members that a writer could add before it is killed; its numbers are its own
PICTURE = np.zeros((8, 8, 4), np.uint8)
BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


def tiny_plan() -> CatalogPlan:
    """One view of one surface."""
    cameras = orbit((0.0, 0.0, 0.0), 1.7, width=8, height=8, frequency=1)[:1]
    space = ParameterSpace((Parameter("number", 0.0, 1e12),))
    return CatalogPlan(space, (Isosurface("surface", 0.5),), tuple(cameras), ("train",), BOX)


def add(catalog: Catalog, name: str, number: int) -> None:
    """Write a member."""
    with catalog.begin_member(name, {"number": float(number)}) as writer:
        writer.write_image("surface", 0, PICTURE)


def times(path: Path, marks: list[int]) -> dict[int, float]:
    """Median milliseconds per member before each mark."""
    catalog, taken = Catalog.create(path, tiny_plan()), []
    started = time.perf_counter()
    for number in range(max(marks)):
        before = time.perf_counter()
        add(catalog, f"m{number:06d}", number)
        taken.append(1e3 * (time.perf_counter() - before))
    click.echo(f"{max(marks):,} members in {time.perf_counter() - started:.0f} s")
    return {mark: statistics.median(taken[max(0, mark - WINDOW) : mark]) for mark in marks}


def write(path: Path, writer: int, first: int, stored: int) -> None:
    """Add members without end, each noted in the file `stored` when it is committed."""
    catalog = Catalog.open(path)
    for number in range(first, first + LIFE):
        name = f"w{writer}-{number:09d}"
        add(catalog, name, writer * 10**9 + number)
        os.write(stored, f"{name}\n".encode())


def kill_writers(folder: Path, kills: int) -> int:
    """Run eight writers and kill them one after the other; returns the number of stored members, raises where one is lost."""
    path, draw, first = folder / "killed.cdb", random.Random(0), dict.fromkeys(range(WRITERS), 0)
    Catalog.create(path, tiny_plan())
    stored = os.open(folder / "stored", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    running: dict[int, int] = {}
    try:
        for _ in range(kills):
            for writer in set(range(WRITERS)) - set(running):
                running[writer] = _started(path, writer, first[writer], stored)
                first[writer] += LIFE
            time.sleep(draw.uniform(0.0, 0.1))
            _kill(running.pop(draw.choice(list(running))))
            _look(path)
    finally:
        for child in running.values():
            os.kill(child, signal.SIGKILL)
    for child in running.values():
        _kill(child)
    os.close(stored)
    return _judge(path, (folder / "stored").read_text().split())


def _look(path: Path) -> None:
    """Check that a Cinema client sees a table of whole members."""
    header, rows = cinema.parse((path / "data.csv").read_bytes().decode())
    missing = [row[-1] for row in rows if not (path / row[-1]).is_file()]
    if missing or cinema.header_problems(header) or (rows and cinema.column_problems(header, rows)):
        raise click.ClickException(f"the table is damaged: {missing[:3]}")


def _started(path: Path, writer: int, first: int, stored: int) -> int:
    child = os.fork()
    if child == 0:
        try:
            write(path, writer, first, stored)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)
    return child


def _kill(child: int) -> None:
    os.kill(child, signal.SIGKILL)
    if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != -signal.SIGKILL:
        raise click.ClickException("a writer ended by itself: its error is printed above")


def _judge(path: Path, reported: list[str]) -> int:
    catalog = Catalog.open(path)
    lost = [name for name in reported if name not in catalog]
    catalog.update_table()
    findings = check(path)
    catalog.rebuild_table()
    if lost or findings or catalog.unfinished():
        raise click.ClickException(
            f"lost {lost[:5]}, findings {[str(f) for f in findings[:5]]}, {catalog.unfinished()[:5]}"
        )
    return len(catalog.member_paths())


@click.command()
@click.option("--members", default="10,1000,10000", show_default=True, help="Where to look, with commas between.")
@click.option("--kills", default=0, help="Kill writers as often, instead of timing one.")
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), help="Where to write; a temporary folder by default."
)
def main(members: str, kills: int, folder: Path | None) -> None:
    """Time commits, or kill writers."""
    place = Path(tempfile.mkdtemp(dir=folder))
    try:
        if kills:
            click.echo(
                f"{kills} kills among {WRITERS} writers: {kill_writers(place, kills):,} members stored, none lost"
            )
            return
        for mark, milliseconds in times(place / "tiny.cdb", [int(part) for part in members.split(",")]).items():
            click.echo(f"{mark:>8,} members: {digits(milliseconds)} ms")
    finally:
        shutil.rmtree(place, ignore_errors=True)


if __name__ == "__main__":
    main()
