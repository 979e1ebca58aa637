"""Choices of `surrogate train --minutes`: more or fewer Gaussians in the same time, and the total time.

    python -m research.benchmarks.training.budgets CATALOG... --minutes 2 [--times 0.25 0.5 1 2 4] [--hold-out 0.2]

Each row is a run of the command, timed from its start to its end, and scored on validation images. Times depend on the
load of the machine: beside other work, only rows of one run can be compared.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import click

from research.benchmarks.page import command_line
from surrogate import Surrogate
from surrogate.storage.runs import RunFolder


def row(catalog: Path, minutes: float, gaussians: int | None, hold_out: float | None) -> tuple[int, str]:
    """The number of Gaussians that training begins with, and a line about them; raises click.ClickException where it fails."""
    options = [] if hold_out is None else ["--hold-out", str(hold_out)]
    words = [] if gaussians is None else [f"gaussians={gaussians}"]
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        command = ["train", str(catalog), *words, "--minutes", str(minutes), *options, "--runs", folder]
        done = subprocess.run([sys.executable, "-m", "surrogate", *command], capture_output=True, text=True)
        taken = (time.perf_counter() - started) / 60.0
        if done.returncode:
            raise click.ClickException(f"surrogate {' '.join(command)}\n{done.stderr.strip()}")
        (run,) = Path(folder).iterdir()
        training, settings = Surrogate.load(run / "surrogate").training, RunFolder.open(run).settings
    psnr = max(point["psnr"] or 0.0 for point in training["curve"])
    model = f"{settings.gaussians:>7,} Gaussians {training['steps']:>7,} steps  validation {psnr:.2f} dB"
    return settings.gaussians, f"{model}  {taken:.2f} of {minutes:g} minutes"


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
