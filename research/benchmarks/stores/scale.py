"""Cost of commands on catalogs of few and of many members: seconds, and the process's peak memory.

    python -m research.benchmarks.stores.scale [--members 10,1000,10000] [--folder DIR]
    python -m research.benchmarks.stores.scale --records-of CATALOG

Every member is one 8x8 image. The members' folders are written by the package's own functions, without waiting for the
disk, and their table is rebuilt once; see `research.benchmarks.stores.commits` for the cost of successive commits. Each
command runs once, in its own process. `check` and `show` run as on the command line, `browse` until its page is written.
`read` is the start of training (every member's record, then an image), `commit` adds one more member. The first commit of
a process also reads the journal.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import resource
import shutil
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import click

from catalogs.browse import page_of
from catalogs.files.images import write_image
from catalogs.store.catalog import Catalog, Member
from catalogs.store.digests import Digests
from catalogs.store.members import write_record
from catalogs.tools.check import check
from catalogs.tools.show import described
from research.benchmarks.stores.commits import PICTURE, add, tiny_plan
from research.benchmarks.timing import digits


def build(path: Path, count: int) -> None:
    """A catalog of `count` members."""
    catalog = Catalog.create(path, tiny_plan())
    plan = catalog.plan
    for number in range(count):
        name = f"m{number:06d}"
        folder = path / "members" / name
        image = folder / plan.image_name("surface", 0)
        image.parent.mkdir(parents=True)
        digest = write_image(image, PICTURE)
        parameters, appearances = {"number": float(number)}, ("surface",)
        member = Member(name, parameters, "train", plan.cameras, plan.view_splits, folder, appearances=appearances)
        write_record(member, plan, Digests({"surface": digest}))
    catalog.rebuild_table()


def run_check(path: Path) -> None:
    """Every rule, and every picture."""
    findings = check(path)
    if findings:
        raise click.ClickException(f"{path}: {findings[0]}")


def run_show(path: Path) -> None:
    """Every line, written to nowhere."""
    with open(os.devnull, "w") as nowhere:
        nowhere.writelines(described(path))


def run_read(path: Path) -> None:
    """Every member's record, and a picture."""
    catalog = Catalog.open(path)
    catalog.image(catalog.members[-1], "surface", 0)


def run_commit(path: Path) -> None:
    """One more member."""
    add(Catalog.open(path), "one-more", 900_000)


COMMANDS: dict[str, Callable[[Path], object]] = {
    "check": run_check,
    "show": run_show,
    "browse": lambda path: page_of(Catalog.open(path)),
    "read": run_read,
    "commit": run_commit,
}


def cost(command: str, path: Path) -> tuple[float, float]:
    """Seconds of a command, and the peak of its process's resident memory in MB."""
    started = time.perf_counter()
    COMMANDS[command](path)
    seconds = time.perf_counter() - started
    return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def costs(path: Path, count: int) -> dict[str, tuple[float, float]]:
    """Cost of every command on a new catalog of `count` members at `path`."""
    fresh = multiprocessing.get_context("spawn")
    with fresh.Pool(1, maxtasksperchild=1) as pool:  # every task gets a fresh process
        pool.apply(build, (path, count))
        return {command: pool.apply(cost, (command, path)) for command in COMMANDS}


def record_bytes(path: Path) -> float:
    """Mean bytes of a member's record in memory, over a catalog's members."""
    catalog = Catalog.open(path)
    tracemalloc.start()
    try:
        members = catalog.members
        gc.collect()
        return tracemalloc.get_traced_memory()[0] / len(members)
    finally:
        tracemalloc.stop()


@click.command()
@click.option("--members", default="10,1000,10000", show_default=True, help="How many, with commas between.")
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), help="Where to write; a temporary folder by default."
)
@click.option(
    "--records-of",
    "catalog",
    type=click.Path(exists=True, path_type=Path),
    help="Say instead what a record of this catalog's members takes.",
)
def main(members: str, folder: Path | None, catalog: Path | None) -> None:
    """Print a table of seconds and peak memory."""
    if catalog is not None:
        click.echo(f"{digits(record_bytes(catalog) / 1e3)} KB a record")
        return
    place = Path(tempfile.mkdtemp(dir=folder))
    try:
        click.echo(" ".join([" members", *(f"{command:>18}" for command in COMMANDS)]))
        for count in [int(part) for part in members.split(",")]:
            taken = costs(place / f"{count}.cdb", count)
            cells = [f"{digits(seconds)} s {megabytes:.0f} MB" for seconds, megabytes in taken.values()]
            click.echo(" ".join([f"{count:>8,}", *(f"{cell:>18}" for cell in cells)]))
            shutil.rmtree(place / f"{count}.cdb")
    finally:
        shutil.rmtree(place, ignore_errors=True)


if __name__ == "__main__":
    main()
