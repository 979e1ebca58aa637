"""Choices of `surrogate train --minutes`: more or fewer Gaussians in the same time, and the total time.

    python -m research.benchmarks.training.budgets CATALOG... --minutes 2 [--times 0.25 0.5 1 2 4] [--hold-out 0.2]

Each row trains the catalog again and is scored on its validation images. Times depend on the load of the machine:
beside other work, only rows of one run can be compared.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from research.benchmarks.page import command_line
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget
from surrogate.training.run import train


def row(catalog: Path, minutes: float, gaussians: int | None, hold_out: float | None) -> tuple[int, str]:
    """The number of trained Gaussians, and a line about them."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        settings = {} if gaussians is None else {"gaussians": gaussians}
        request = TrainingOptions(Budget(minutes=minutes), hold_out, settings)
        run = begin(catalog, Path(folder) / "run", request, elapsed=lambda: time.perf_counter() - started)
        surrogate = train(run.settings, run.catalog, run.model)
    taken, steps = (time.perf_counter() - started) / 60.0, surrogate.training["steps"]
    psnr = max(point["psnr"] or 0.0 for point in surrogate.training["curve"])
    text = f"{run.settings.gaussians:>7,} Gaussians {steps:>7,} steps  validation {psnr:.2f} dB  {taken:.2f} of {minutes:g} minutes"
    return run.settings.gaussians, text


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for the command's own choice, and one for each multiple of its Gaussians."""
    parser = command_line("training.budgets", __doc__)
    parser.add_argument("catalogs", nargs="+", type=Path)
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--times", type=float, nargs="*", default=[0.25, 0.5, 2.0, 4.0])
    parser.add_argument("--hold-out", type=float)
    given = parser.parse_args(arguments)
    for catalog in given.catalogs:
        chosen, text = row(catalog, given.minutes, None, given.hold_out)
        print(f"{catalog}\n  as chosen {text}", flush=True)
        for times in given.times:
            _, text = row(catalog, given.minutes, max(1, round(times * chosen)), given.hold_out)
            print(f"  {times:>7g} x {text}", flush=True)


if __name__ == "__main__":
    main()
