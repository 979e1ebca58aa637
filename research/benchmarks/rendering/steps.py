"""Check of chosen sample distances: the error of views that they were not chosen on, of the same member and of others.

    python -m research.benchmarks.rendering.steps FILE [--members 0,37,111] [--targets 40,50,55] [--size 128]

FILE is the CloverLeaf3D ensemble of scenes/cloverleaf.toml.  Each member chooses its distance for each target; errors are those
of 8-bit pictures of 28 other views against pictures with samples a 24th of a spacing apart.  A catalog's later members have the
first one's distance, unless they change more from sample to sample, and are then measured, as the hook does it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import orbit
from catalogs.vocabulary.scene import Scene
from render import Grid, choose_sample_distance
from render.quality import HARDER, WholeField, checked_sample_distance, psnr
from render.steepness import mean_change
from research.benchmarks.page import PROJECT, table
from research.benchmarks.rendering.casting import members
from research.benchmarks.timing import digits, processor_seconds

FINEST, VIEWS = 1 / 24, range(2, 252, 9)


def decibels(grid: Grid, appearance: VolumeRendering, size: int, distances: Sequence[float]) -> list[float]:
    """Of views that nothing was chosen on, at each distance."""
    around = orbit(grid.center, grid.bounding_radius, width=size, height=size)
    cameras, field = [around[view] for view in VIEWS], WholeField(grid)
    finest = np.stack(
        list(field.pictures(appearance, cameras, FINEST * min(grid.spacing), float_output=True))
    )  # [views, H, W, 4]
    found = []
    for distance in distances:
        pictures = np.stack(list(field.pictures(appearance, cameras, distance, float_output=False)))
        found.append(psnr(pictures / 255.0, finest))
    return found


@click.command(help=__doc__)
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--members", "numbers", default="0,37,111", help="Members, by number.")
@click.option("--targets", default="40,50,55", help="Decibels.")
@click.option("--size", default=128, help="Pixels along each side.")
def main(file: Path, numbers: str, targets: str, size: int) -> None:
    (appearance,) = Scene.load(PROJECT / "scenes" / "cloverleaf.toml").appearances
    assert isinstance(appearance, VolumeRendering)
    chosen_by, rows = [int(number) for number in numbers.split(",")], []
    grids = members(file, chosen_by)
    for target in map(float, targets.split(",")):
        first: tuple[float, float] | None = None
        for number, grid in zip(chosen_by, grids, strict=True):
            cameras = orbit(grid.center, grid.bounding_radius, width=size, height=size)
            own = []
            seconds = processor_seconds(
                lambda grid=grid, cameras=cameras, own=own, target=target: own.append(
                    choose_sample_distance(grid, appearance, cameras, target, warn=False)
                )
            )
            change = mean_change(grid, appearance.transfer_function)
            first = first or (own[0].distance, change)
            later = first[0]
            if change > HARDER * first[1]:
                later = checked_sample_distance(grid, appearance, cameras, later, target).distance
            measured = decibels(grid, appearance, size, [own[0].distance, later])
            smallest = min(grid.spacing)
            row = [str(number), f"{target:g}", f"{own[0].distance / smallest:.3g}", digits(1e3 * seconds)]
            rows.append([*row, digits(measured[0]), f"{later / smallest:.3g}", digits(measured[1])])
    columns = ["member", "target, dB", "own distance, spacings", "chosen in, processor ms", "dB of other views"]
    print(table([*columns, "distance in the catalog", "dB"], rows))


if __name__ == "__main__":
    main()
