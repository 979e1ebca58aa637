"""Memory and time of training steps over the number of pictures, most of which are read when a step needs them.

    python -m research.benchmarks.training.streaming CATALOG [--pictures 2000,25000] [--gaussians 40000] [--steps 100] [--write]

The catalog's training members are repeated, at other places in parameter space, until they have that many pictures.
Their files are linked, so a picture is on the disk once, and in its cache once, however often it is repeated.
Processes of their own train on each number of pictures for `--steps` steps and for three times as many. The difference
is the time of a step; the greater peak of resident memory is printed. Catalogs and runs are in RUNS/streaming, and are
removed afterwards. Prints Markdown; `--write` puts it into docs/results/training.md.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from catalogs.store.catalog import Catalog, Member
from catalogs.store.members import CAMERAS, RECORD, ROWS, read_member, write_record
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table

PAGE, PART, FOLDER = RESULTS / "training.md", "streaming", "streaming"
HEADER = ("pictures", "decoded, GB", "peak memory, GB", "processor ms a step", "elapsed ms a step")
WRITTEN = shutil.ignore_patterns(RECORD, ROWS, CAMERAS)  # for each member anew
LONGER = 3  # times the steps of the shorter training


@dataclass(frozen=True)
class Cost:
    """Of a process: processor and elapsed seconds, and the peak of its resident memory in bytes."""

    processor: float
    elapsed: float
    memory: int


def repeated(source: Catalog, path: Path, pictures: int) -> Catalog:
    """A catalog of the members of `source`, of which those to train on are repeated until they have that many `pictures`."""
    catalog = Catalog.create(path, source.plan)
    for number, member in enumerate(_enough(source, pictures)):
        moved = _moved(member, number, source)
        shutil.copytree(member.path, path / "members" / moved.name, ignore=WRITTEN, copy_function=os.link)
        _, digests = read_member(member.path, source.plan)
        write_record(replace(moved, path=path / "members" / moved.name), source.plan, digests)
    catalog.rebuild_table()
    return Catalog.open(path)


def _enough(source: Catalog, pictures: int) -> Iterator[Member]:
    """The other members, then those to train on, over and over."""
    training = [member for member in source.members if member.split == "train"]
    if not training or pictures < 1:
        raise ValueError(f"{source.path}: training members and at least one picture are needed, got {pictures}")
    yield from (member for member in source.members if member.split != "train")
    shown, again = 0, (member for _ in count() for member in training)
    while shown < pictures:
        member = next(again)
        shown += member.view_splits.count("train") * len(member.appearances)
        yield member


def _moved(member: Member, number: int, source: Catalog) -> Member:
    """A member under another name; the first parameter of a repeated one is drawn towards the middle of its bounds."""
    if member.split != "train":
        return member
    first = source.plan.space.parameters[0]
    middle = (first.low + first.high) / 2.0
    value = middle + (member.parameters[first.name] - middle) / (1.0 + number / 1000.0)
    return replace(member, name=f"repeated-{number:05d}", parameters={**member.parameters, first.name: value})


def cost(catalog: Catalog, run: Path, gaussians: int, steps: int) -> Cost:
    """Of a training in a process of its own; raises subprocess.CalledProcessError where that fails."""
    settings = (f"gaussians={gaussians}", "canonical_steps=0", f"deformation_steps={steps}", "fit_to_need=false")
    command = [sys.executable, "-m", "surrogate", "train", str(catalog.path), "-o", str(run), *settings]
    started = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    memory = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return Cost(usage.ru_utime + usage.ru_stime, time.perf_counter() - started, memory)


def row(catalog: Catalog, folder: Path, gaussians: int, steps: int) -> list[str]:
    """Of the table."""
    members = [member for member in catalog.members if member.split == "train"]
    cameras = [c for m in members for c, split in zip(m.cameras, m.view_splits, strict=True) if split == "train"]
    channels = 4 if catalog.plan.background is None else 3
    appearances = len(catalog.plan.appearances)
    decoded = sum(camera.width * camera.height for camera in cameras) * channels * appearances
    short, long = (cost(catalog, folder / f"{n}-steps", gaussians, n) for n in (steps, LONGER * steps))
    more = (LONGER - 1) * steps
    times = (1e3 * (long.processor - short.processor) / more, 1e3 * (long.elapsed - short.elapsed) / more)
    cells = [f"{len(cameras) * appearances:,}", f"{decoded / 1e9:.1f}", f"{max(short.memory, long.memory) / 1e9:.2f}"]
    return [*cells, *(f"{milliseconds:.0f}" for milliseconds in times)]


def measured(source: Catalog, folder: Path, pictures: int, gaussians: int, steps: int) -> list[str]:
    """The table's row for a number of pictures; `folder` is removed before and afterwards."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        return row(repeated(source, folder / "catalog.cdb", pictures), folder, gaussians, steps)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def main() -> None:
    """Build, train, print."""
    parser, say = command_line("training.streaming", __doc__), stopwatch()
    parser.add_argument("catalog", type=Path, metavar="CATALOG")
    parser.add_argument("--pictures", default="2000,25000", help="How many, with commas between.")
    parser.add_argument("--gaussians", type=int, default=40_000)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    parser.add_argument("--write", action="store_true", help="into docs/results/training.md")
    given, rows = parser.parse_args(), list[list[str]]()
    try:
        source = Catalog.open(given.catalog)
        for number in [int(part) for part in given.pictures.split(",")]:
            say(f"{number:,} pictures")
            rows.append(measured(source, given.runs / FOLDER, number, given.gaussians, given.steps))
    except (ValueError, OSError, subprocess.CalledProcessError) as error:
        parser.error(str(error))
    words = f"{given.catalog} --pictures {given.pictures} --gaussians {given.gaussians} --steps {given.steps}"
    publish(
        f"{table(HEADER, rows)}\n<sub>{made_by(f'training.streaming {words}')}</sub>", PAGE, PART, write=given.write
    )


if __name__ == "__main__":
    main()
