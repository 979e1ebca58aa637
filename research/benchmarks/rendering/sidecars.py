"""Cost of a member's sidecar in kilobytes and milliseconds, by the number of points that fill the box evenly.

    python -m research.benchmarks.rendering.sidecars [--sizes 64,256] [--even 0,2000,8000]

The field is a sum of waves on size³ samples under one transfer function. Times are medians of calls in one process: of
the summary without the even points (histogram, range, 4,000 points by opacity), and of the even points.
"""

from __future__ import annotations

import os
import platform
import tempfile
from functools import partial
from pathlib import Path

import click
import numpy as np

from catalogs.store.summary import save_summaries
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from insitu.fields.summarize import FieldPart, sample_evenly, summarize
from render import Grid, to_grid
from research.benchmarks.timing import digits, measured

FUNCTION = TransferFunction(((-3.0, 0.0, 0.0, 1.0), (3.0, 1.0, 0.0, 0.0)), ((1.0, 0.0), (3.0, 0.6)), 0.3)
SHIFT = np.full(3, 0.5)
WAVES = VolumeRendering("waves", FUNCTION)
HEADER = "| samples | even points | sidecar, kB | these points, ms | the rest of the summary, ms |"


def waves(size: int) -> Grid:
    """Three products of sines, (z, y, x)."""
    line = np.linspace(0.0, 2.0 * np.pi, size, dtype=np.float32)
    x, y, z = line, line[:, None], line[:, None, None]
    values = np.sin(x) * np.cos(2 * y) + np.sin(3 * y + 1) * np.cos(z) + np.sin(5 * z) * np.cos(4 * x)
    return to_grid(values, spacing=2.0 * np.pi / (size - 1))


def stored_bytes(grid: Grid, count: int) -> int:
    """Bytes of the sidecar with `count` even points."""
    summary = summarize(grid, [WAVES], FUNCTION.bounds, even_points=count)
    with tempfile.TemporaryDirectory() as folder:
        save_summaries(Path(folder) / "field.npz", {"": summary})
        return (Path(folder) / "field.npz").stat().st_size


@click.command()
@click.option("--sizes", default="64,256", show_default=True, help="Samples along each axis, with commas between.")
@click.option("--even", default="0,2000,8000", show_default=True, help="Numbers of even points.")
@click.option("--seconds", default=10.0, show_default=True, help="Each time is measured so long.")
def main(sizes: str, even: str, seconds: float) -> None:
    """Print the table."""
    click.echo(f"{HEADER}\n|{' --- |' * 5}")
    for size in map(int, sizes.split(",")):
        grid = waves(size)
        rest = measured(partial(summarize, grid, [WAVES], FUNCTION.bounds, even_points=0), seconds).median
        for count in map(int, even.split(",")):
            taken = measured(partial(sample_evenly, FieldPart.all_of(grid), count, SHIFT), seconds).median
            cells = [f"{size}³", f"{count:,}", f"{stored_bytes(grid, count) / 1e3:.0f}", digits(taken), digits(rest)]
            click.echo(f"| {' | '.join(cells)} |")
    load = " ".join(f"{value:.0f}" for value in os.getloadavg())
    click.echo(f"\n{os.cpu_count()} cores ({platform.machine()}), load {load}, medians")


if __name__ == "__main__":
    main()
