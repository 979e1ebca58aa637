"""Time splatting, a training step and training itself, beside their errors, and write docs/results/splatting.md and its plots.

    python -m research.benchmarks.splatting [--quick] [--only PART ...] [--output DIRECTORY]

About fifteen minutes of two cores, which should have nothing else to do.  Every part is written as soon as it is measured, and
one that fails leaves the others alone.  `--quick` tries everything in about a minute and writes elsewhere.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import torch

from research.benchmarks.page import PROJECT, RESULTS, command_line, made_by, page_in, stopwatch, write_parts
from research.benchmarks.splatting.budgets import budgets
from research.benchmarks.splatting.constants import constants
from research.benchmarks.splatting.cutoffs import cutoffs
from research.benchmarks.splatting.engine import backends, fixed, loss, others
from research.benchmarks.splatting.precisions import precisions
from research.benchmarks.splatting.scaling import scaling
from research.benchmarks.splatting.setup import Setup
from research.benchmarks.splatting.simd.compare import compare
from research.benchmarks.splatting.step import step
from research.benchmarks.splatting.trained import TrainedModels, training_time
from surrogate.provenance import in_words, machine
from surrogate.splatting.threads import one_torch_thread

PAGE = "splatting.md"
QUICK = "bench"  # within the folder of runs

Part = Callable[[Setup, TrainedModels], str]
PARTS: Mapping[str, Part] = {
    "fixed": lambda setup, _: fixed(setup),
    "others": lambda setup, _: others(setup),
    "backends": lambda setup, _: backends(setup),
    "loss": lambda setup, _: loss(setup),
    "step": lambda setup, _: step(setup),
    "scaling": lambda setup, _: scaling(setup),
    "training": training_time,
    "budgets": budgets,
    "precisions": precisions,
    "cutoffs": cutoffs,
    "constants": constants,
    "simd": lambda setup, _: compare(),
}


def main() -> None:
    parser = command_line("splatting", __doc__)
    parser.add_argument("--quick", action="store_true", help="a few points for a moment, written to runs/bench/")
    parser.add_argument(
        "--only", nargs="+", choices=list(PARTS), default=list(PARTS), metavar="PART", help=", ".join(PARTS)
    )
    parser.add_argument("--output", type=Path, help="folder of the page and its plots; default docs, or runs/bench")
    parser.add_argument("--runs", type=Path, default=PROJECT / "runs", help="folder of the scenes' results")
    arguments = parser.parse_args()
    output = arguments.output or (arguments.runs / QUICK if arguments.quick else RESULTS)
    setup = Setup(arguments.quick, output, arguments.runs, stopwatch())
    page = output / PAGE if output.joinpath(PAGE).exists() and not setup.quick else page_in(output, PAGE)
    trained = TrainedModels(setup)
    parts = {name: partial(PARTS[name], setup, trained) for name in arguments.only}
    with one_torch_thread():
        failed = write_parts(page, parts, provenance(setup.quick), setup.say)
    setup.say(f"{page}" + (f"; failed: {', '.join(failed)}" if failed else ""))
    sys.exit(bool(failed))


def provenance(quick: bool) -> str:
    """The line under every table."""
    about = machine()
    on = f"{in_words(about)}, {about['system']}, torch {torch.__version__}"
    return f"{made_by('splatting' + ' --quick' * quick, on=on)}. Times: median (fastest to slowest), wall clock."


if __name__ == "__main__":
    main()
