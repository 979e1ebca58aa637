"""Value of batches of several images, and the cost of their steps when processes share them.

    python -m research.benchmarks.training.ranks CATALOG [--images 12000] [--seeds 3] [--processes 2] [--quick]
    [--machine "two cores"]

Trains on the CATALOG with 1, 2 and 4 images a step, as many images in all, and judges the results by test images.  Then some steps
of each batch are taken by one process and by several that `torchrun` starts.  Their processor time depends little on what else the
machine does; wall-clock time does.  Writes two tables in docs/results/clusters.md; half an hour on one loaded
core for runs/tiny/catalog.cdb, which `insitu dataset` makes of scenes/tiny.toml.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch

from catalogs.store.catalog import Catalog
from research.benchmarks.page import PROJECT, RESULTS, command_line, made_by, page_in, stopwatch, table, write_parts
from research.benchmarks.timing import MeasuredTime, digits, timed
from surrogate import Surrogate, TrainingSettings, train
from surrogate.evaluation.cases import base_cells
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import mean, score_cases, spread
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.runs import with_chosen_splits
from surrogate.training.loop import StageRun
from surrogate.training.ranks import Ranks, launched
from surrogate.training.source import Source
from surrogate.training.stages import new_deformation, simulation_stage

BATCHES = (1, 2, 4)
GAUSSIANS = 2_000
TIMED = (2_000, 20_000)  # Gaussians
CANONICAL = 0.2  # of the steps
SCORED = 120  # test images


def settings_of(batch: int, images: int, seed: int = 0) -> TrainingSettings:
    """The settings of a training on `images` images, `batch` a step."""
    steps = images // batch
    canonical = round(CANONICAL * steps)
    return TrainingSettings(
        gaussians=GAUSSIANS,
        canonical_steps=canonical,
        deformation_steps=steps - canonical,
        validation_interval=0,
        fit_to_need=False,
        color_degree=0,
        seed=seed,
        batch=batch,
    )


def trained(catalog: Catalog, images: int, seeds: int, say: Callable[[str], None]) -> str:
    """The table of PSNR at equal images."""
    header = ["images a step", "steps", "PSNR at test images, dB"]
    rows = []
    for batch in BATCHES:
        scores = []
        for seed in range(seeds):
            with tempfile.TemporaryDirectory() as folder:
                made = train(settings_of(batch, images, seed), catalog, folder)
            scores.append(_score(made, catalog))
            say(f"batch {batch}, seed {seed}: {scores[-1]:.2f} dB")
        deviation = f" ± {statistics.stdev(scores):.2f}" if seeds > 1 else ""
        rows.append([str(batch), f"{images // batch:,}", f"{statistics.fmean(scores):.2f}{deviation}"])
    shown = f"{GAUSSIANS:,} Gaussians, {images:,} images in all, mean and standard deviation over {seeds} seeds."
    return f"{shown}\n\n{table(header, rows)}"


@one_torch_thread()
def _score(surrogate: Surrogate, catalog: Catalog) -> float:
    cases = list(base_cells(catalog, str(surrogate.training["appearance"]))["unseen_views"]["unseen_parameters"])
    some = [cases[i] for i in spread(len(cases), SCORED)]
    [scores] = score_cases(SurrogatePredictor(surrogate.at, catalog.plan.background), catalog, some)
    psnr = mean(scores.values(), "psnr")
    if psnr is None:
        raise ValueError(f"{catalog.path} has no test images at unseen views and parameters")
    return psnr


def shared(path: Path, processes: int, quick: bool, say: Callable[[str], None]) -> str:
    """The table of what a step costs."""
    header = [
        "Gaussians",
        "images a step",
        "processes",
        "a step, processor ms of each",
        "a step, ms",
        "all-reduce alone, ms",
        "MB",
    ]
    rows = []
    cases = [(n, b, c) for n in TIMED for b in BATCHES for c in ((1, processes) if b >= processes else (1,))]
    for gaussians, batch, count in cases[:3] if quick else cases:
        figures = _measured_by(path, gaussians, batch, count, quick)
        say(f"{gaussians} Gaussians, batch {batch}, {count} processes: {figures}")
        exchanged = [digits(figures["reduce"]), f"{figures['megabytes']:.1f}"] if count > 1 else ["", ""]
        times = [digits(figures["processor"]), digits(figures["wall"])]
        rows.append([f"{gaussians:,}", str(batch), str(count), *times, *exchanged])
    return table(header, rows)


def _measured_by(path: Path, gaussians: int, batch: int, count: int, quick: bool) -> dict[str, float]:
    """The first process's figures."""
    module = [
        "-m",
        "research.benchmarks.training.ranks",
        str(path),
        "--measure",
        str(gaussians),
        str(batch),
        *(["--quick"] if quick else []),
    ]
    launch = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(count)] if count > 1 else []
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, *launch, *module], cwd=PROJECT, env=environment, capture_output=True, text=True
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    figures: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return figures


@one_torch_thread()
def measure(catalog: Catalog, count: int, batch: int, ranks: Ranks, steps: int) -> dict[str, float]:
    """Milliseconds of a step of stage 2 with `count` Gaussians, and of the all-reduce in it by itself."""
    settings = settings_of(batch, 1_000_000).changed(gaussians=count)
    source = Source(settings, catalog, ranks)
    data = source.data()
    gaussians = source.initial_gaussians(data)
    stage = simulation_stage(gaussians, new_deformation(gaussians, len(catalog.plan.space), settings), settings)
    run = StageRun(stage, settings, data)
    for _ in range(steps // 4):
        run.advance()
    began, worked = time.perf_counter(), time.process_time()
    for _ in range(steps):
        run.advance()
    processor, wall = time.process_time() - worked, time.perf_counter() - began
    numbers = torch.zeros(sum(tensor.numel() for tensor in stage.tensors.values()))
    reduced = MeasuredTime.of([timed(lambda: ranks.add(numbers)) for _ in range(steps)])
    return {
        "processor": 1e3 * statistics.fmean(ranks.gathered(processor)) / steps,
        "wall": 1e3 * wall / steps,
        "reduce": reduced.median,
        "megabytes": 4e-6 * numbers.numel(),
    }


def main(arguments: Sequence[str] | None = None, say: Callable[[str], None] | None = None) -> None:
    """Write the tables."""
    options = command_line("training.ranks", __doc__)
    options.add_argument("catalog", type=Path)
    options.add_argument("--images", type=int, default=12_000, help="of each training")
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--processes", type=int, default=2)
    options.add_argument("--measure", type=int, nargs=2, metavar=("GAUSSIANS", "BATCH"), help=argparse.SUPPRESS)
    options.add_argument("--quick", action="store_true", help="few images and steps: does it run?")
    options.add_argument("--machine", default="", help="the machine, in words")
    options.add_argument("--output", type=Path, default=RESULTS, help="folder that holds clusters.md")
    given = options.parse_args(arguments)
    catalog = with_chosen_splits(Catalog.open(given.catalog), TrainingSettings(), None, 0)
    if given.measure:
        with launched() as ranks:
            figures = measure(catalog, *given.measure, ranks, 8 if given.quick else 200)
            if ranks.is_first:
                print(json.dumps(figures))
        return
    images, seeds = (40, 1) if given.quick else (given.images, given.seeds)
    say = say or stopwatch()
    parts: dict[str, Any] = {
        "batches": lambda: trained(catalog, images, seeds, say),
        "ranks": lambda: shared(given.catalog, given.processes, given.quick, say),
    }
    made = made_by(f"training.ranks {given.catalog}", on=given.machine)
    if write_parts(page_in(given.output, "clusters.md"), parts, made, say):
        sys.exit(1)


if __name__ == "__main__":
    main()
