"""Growth of a process that renders many members: resident memory and open files after few and after many.

    python -m research.benchmarks.hook.growth [--members 2000] [--marks 200] [--folder DIR]

One process renders tiny members, a blob of 8³ samples from 12 viewpoints of 16x16 pixels, through one `insitu.Session`.
At each mark and at the end, the system's counts (psutil) are read after a garbage collection. Growth per member between
the first mark and the end is a leak.
"""

from __future__ import annotations

import gc
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import psutil

import insitu
from catalogs.version import commit
from research.benchmarks.timing import digits

SIZE = 8
LOOK = insitu.VolumeRendering(
    "dvr", insitu.TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.2, 0.0), (1.0, 0.6)), 0.3)
)


@dataclass(frozen=True)
class ProcessState:
    """State of the process after `members` members: resident memory in MB, open file descriptors, threads."""

    members: int
    megabytes: float
    files: int
    threads: int

    @classmethod
    def now(cls, members: int) -> ProcessState:
        """This process."""
        gc.collect()
        process = psutil.Process()
        return cls(members, process.memory_info().rss / 1e6, process.num_fds(), process.num_threads())


def states(path: Path, members: int, marks: Iterable[int]) -> list[ProcessState]:
    """Render `members` members into a new catalog; returns the state at each mark, and at the end."""
    wanted, states_at_marks = {*marks, members}, []
    space = insitu.ParameterSpace((insitu.Parameter("width", 0.2, 0.8),))
    views = insitu.ViewPlan(frequency=1, width=16, height=16)
    axis = np.linspace(-1.0, 1.0, SIZE)
    distances = axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2  # [z, y, x]
    with insitu.Session(path, space=space, appearances=LOOK, views=views, sample_distance=0.2) as session:
        for number in range(1, members + 1):
            width = 0.2 + 0.6 * number / members
            field = np.exp(-distances / (2.0 * width**2)).astype(np.float32)
            session.render_member(field, {"width": width}, spacing=(2.0 / (SIZE - 1),) * 3)
            if number in wanted:
                states_at_marks.append(ProcessState.now(number))
    return states_at_marks


@click.command()
@click.option("--members", default=2000, show_default=True, help="How many to render.")
@click.option("--marks", default="200", show_default=True, help="After how many to look, with commas between.")
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), help="Where to write; a temporary folder by default."
)
def main(members: int, marks: str, folder: Path | None) -> None:
    """Print the state of the process at each mark, and its growth per member."""
    place = Path(tempfile.mkdtemp(dir=folder))
    try:
        history = states(place / "growth.cdb", members, [int(mark) for mark in marks.split(",")])
        click.echo(f"commit {commit()}")
        for state in history:
            click.echo(
                f"after {state.members:>6,} members: {state.megabytes:.1f} MB resident, {state.files} open files, "
                f"{state.threads} threads"
            )
        first, last = history[0], history[-1]
        if last.members > first.members:
            grown = 1e3 * (last.megabytes - first.megabytes) / (last.members - first.members)
            click.echo(f"{digits(grown)} KB for each member since the first mark")
    finally:
        shutil.rmtree(place, ignore_errors=True)


if __name__ == "__main__":
    main()
