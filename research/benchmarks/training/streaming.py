"""Memory and time of training steps over the number of pictures, most of which are read when a step needs them.

    python -m research.benchmarks.training.streaming CATALOG [--pictures 2000,25000] [--gaussians 40000] [--steps 100] [--write]

The catalog's training members are repeated, at other places in parameter space, until they have that many pictures.
Their files are linked, so a picture is on the disk once, and in its cache once, however often it is repeated.
Processes of their own train on each number of pictures for `--steps` steps and for three times as many. The difference
is the time of a step; the greater peak of resident memory is printed. Catalogs and runs are in RUNS/streaming, and are
removed afterwards. Prints Markdown; `--write` puts it into docs/results/training.md.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np

from catalogs.store.catalog import Catalog, Member
from catalogs.store.members import CAMERAS, RECORD, ROWS, read_member, write_record
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from surrogate.settings import TrainingSettings
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.data import TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.stages import new_deformation, simulation_stage

PAGE, PART, FOLDER = RESULTS / "training.md", "streaming", "streaming"
HEADER = ("pictures", "decoded, GB", "peak memory, GB", "processor ms a step", "elapsed ms a step")
WRITTEN = shutil.ignore_patterns(RECORD, ROWS, CAMERAS)  # for each member anew


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


def peak_memory(catalog: Catalog, run: Path, words: Sequence[str]) -> int:
    """Bytes resident in a training of its own process; raises subprocess.CalledProcessError where that fails."""
    command = [sys.executable, "-m", "surrogate", "train", str(catalog.path), "-o", str(run), *words]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)


@one_torch_thread()
def step_seconds(catalog: Path, settings: TrainingSettings, steps: int) -> tuple[float, float]:
    """`median_step` of stage 2."""
    source = Source(settings, Catalog.open(catalog))
    return median_step(deformation_run(source, source.data(), settings), steps)


def deformation_run(source: Source, data: TrainingData, settings: TrainingSettings) -> StageRun:
    """Stage 2 before its first step, from the source's starting Gaussians."""
    gaussians = source.initial_gaussians(data)
    deformation = new_deformation(gaussians, len(source.space), settings)
    return StageRun(simulation_stage(gaussians, deformation, settings), settings, data)


def median_step(run: StageRun, steps: int) -> tuple[float, float]:
    """Median seconds of the next steps on the processor's clock and on the wall's, the first few, which are slower, aside."""
    times = []
    for _ in range(steps):
        run.advance()
        times.append((time.process_time(), time.perf_counter()))
    spent = np.diff(np.array(times), axis=0)[steps // 4 :]  # [S, 2]
    processor, elapsed = np.median(spent, axis=0)
    return float(processor), float(elapsed)


def row(catalog: Catalog, folder: Path, settings: TrainingSettings, steps: int) -> list[str]:
    """Of the table."""
    members = [member for member in catalog.members if member.split == "train"]
    cameras = [c for m in members for c, split in zip(m.cameras, m.view_splits, strict=True) if split == "train"]
    channels = 4 if catalog.plan.background is None else 3
    appearances = len(catalog.plan.appearances)
    decoded = sum(camera.width * camera.height for camera in cameras) * channels * appearances
    words = [f"gaussians={settings.gaussians}", "canonical_steps=0", f"deformation_steps={steps}", "fit_to_need=false"]
    memory = peak_memory(catalog, folder / "run", words)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        seconds = pool.apply(step_seconds, (catalog.path, settings, steps))
    cells = [f"{len(cameras) * appearances:,}", f"{decoded / 1e9:.1f}", f"{memory / 1e9:.2f}"]
    return [*cells, *(f"{1e3 * each:.0f}" for each in seconds)]


def measured(source: Catalog, folder: Path, pictures: int, gaussians: int, steps: int) -> list[str]:
    """The table's row for a number of pictures; `folder` is removed before and afterwards."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        settings = TrainingSettings(gaussians=gaussians, canonical_steps=0, deformation_steps=steps)
        return row(repeated(source, folder / "catalog.cdb", pictures), folder, settings, steps)
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
