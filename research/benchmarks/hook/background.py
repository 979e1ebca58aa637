"""Cost of a dump for the simulation loop, in time and memory: rendering in the background, and waiting for the images.

    LP_NUM_THREADS=0 python -m research.benchmarks.hook.background [--sizes 64,128,256,512] [--views 42] [--dumps 5]

Each row has its own process. Three kinds of loop: "float32" and "float64" keep a plain array; "halo" passes the inner
part of an array with a border of two, as solvers store fields. Milliseconds are the median of the dumps after the
first, which allocates memory and is given separately, with room in the queue. The loop is idle between dumps, as if its
steps took as long as rendering. Megabytes are the peak resident memory of the loop's process above that before the
first dump (Python and the field). They exclude the shared memory: one field for each queued member, two by default.
"""

from __future__ import annotations

import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
import numpy as np
import psutil

from research.benchmarks.timing import digits

HALO = 2
KINDS = ("float32", "float64", "halo")
HEADER = ("field", "samples", "field MB", "first dump ms", "later dumps ms", "loop MB", "blocking ms", "blocking MB")


def field_of(kind: str, size: int) -> np.ndarray:
    """A blob of `size`³ samples (z, y, x)."""
    dtype = np.float64 if kind == "float64" else np.float32
    count = size + 2 * HALO if kind == "halo" else size
    line = np.exp(-(np.linspace(-2.0, 2.0, count) ** 2)).astype(dtype)
    values = line[:, None, None] * line[:, None] * line
    return values[HALO:-HALO, HALO:-HALO, HALO:-HALO] if kind == "halo" else values


def loop(kind: str, size: int, views: int, dumps: int, background: bool) -> dict[str, float]:
    """Milliseconds of the first dump and of later ones, and megabytes, in this process."""
    from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
    from catalogs.vocabulary.scene import ViewPlan
    from insitu.hook.session import Session
    from insitu.members.result import PeakMemory

    field = field_of(kind, size)
    function = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.2, 0.0), (1.0, 0.6)), 0.3)
    frequency = max(1, round(((views - 2) / 10) ** 0.5))
    spacing = (4.0 / size,) * 3
    with (
        tempfile.TemporaryDirectory() as folder,
        Session(
            Path(folder) / "a.cdb",
            space={"step": (0.0, 1e6)},
            appearances=VolumeRendering("dvr", function),
            views=ViewPlan(frequency=frequency, width=256, height=256),
            sample_distance=spacing[0],
            background=background,
            warn=lambda note: click.echo(f"{kind} {size}: {note}", err=True),
        ) as session,
    ):
        taken, memory = [], PeakMemory()
        for step in range(dumps):
            started = time.perf_counter()
            session.render_member(field, {"step": float(step)}, spacing=spacing)
            taken.append(1e3 * (time.perf_counter() - started))
            memory.sample()
            while len(session.results) <= step - 1 or (step == 0 and not session.results):
                time.sleep(0.05)
        extra = memory.extra_bytes
    return {
        "first": taken[0],
        "later": statistics.median(taken[1:]),
        "megabytes": extra / 1e6,
        "failed": len(session.failures),
    }


def measured(kind: str, size: int, views: int, dumps: int, background: bool) -> dict[str, float]:
    """The measurements of `loop` in a fresh process."""
    arguments = [kind, size, views, dumps, background]
    command = [sys.executable, "-m", "research.benchmarks.hook.background", "--one", json.dumps(arguments)]
    ran = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(ran.stdout.splitlines()[-1])


@click.command()
@click.option(
    "--sizes", default="64,128,256,512", show_default=True, help="Samples along each axis, with commas between."
)
@click.option("--views", default=42, show_default=True, help="About as many pictures of 256 x 256 a dump.")
@click.option(
    "--dumps", default=5, show_default=True, type=click.IntRange(2), help="In the background; two when waiting."
)
@click.option("--one", hidden=True)
def main(sizes: str, views: int, dumps: int, one: str | None) -> None:
    """Print the table."""
    if one is not None:
        click.echo(json.dumps(loop(*json.loads(one))))
        return
    click.echo(f"| {' | '.join(HEADER)} |\n|{' --- |' * len(HEADER)}")
    for size in map(int, sizes.split(",")):
        for kind in KINDS:
            apart = measured(kind, size, views, dumps, True)
            waiting = measured(kind, size, views, 2, False)
            megabytes = size**3 * (8 if kind == "float64" else 4) / 1e6
            cells = [apart["first"], apart["later"], apart["megabytes"], waiting["later"], waiting["megabytes"]]
            click.echo(f"| {kind} | {size}³ | {megabytes:,.0f} | {' | '.join(map(digits, cells))} |")
    load = " ".join(f"{value:.0f}" for value in os.getloadavg())
    cores = len(psutil.Process().cpu_affinity())
    click.echo(f"\n{cores} cores ({platform.machine()}), load {load}, {views} views, medians of {dumps - 1} dumps")


if __name__ == "__main__":
    main()
