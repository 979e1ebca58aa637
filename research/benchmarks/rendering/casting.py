"""Accuracy and processor time of the ray caster beside VTK.

    python -m research.benchmarks.rendering.casting FILE [--members 0,37,111] [--isovalues 1.5,2.5,3.2] [--size 256]

FILE is the CloverLeaf3D ensemble of scenes/cloverleaf.toml. Volumes are drawn by one thread at several sample distances.
Their error is against samples a 24th of a spacing apart, and against VTK's float images at the same steps. Isosurfaces
are compared with VTK's. Unlit surfaces show the outline alone. Times are the least processor time of several calls, which
busy neighbours can only lengthen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import click
import h5py
import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from catalogs.vocabulary.scene import Scene
from native.kernels import instruction_sets
from native.ray_casting import SampledField, SurfaceCaster, VolumeCaster
from render import Grid, render_views, to_grid
from render.quality import psnr
from research.benchmarks.page import PROJECT, table
from research.benchmarks.timing import digits, processor_seconds

SPACINGS = (2.0, 1.5, 1.25, 1.0, 0.7, 0.5, 0.25)  # sample distances
VIEWS, FINEST, CALLS = (20, 75, 140), 1 / 24, 15
UNLIT = {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0}

Images = NDArray[np.float32]  # [views, H, W, 4]


def members(path: Path, numbers: Sequence[int]) -> list[Grid]:
    with h5py.File(path) as file:
        spacing, origin = (file.attrs[name] for name in ("spacing", "origin"))
        return [to_grid(file["field"][number].astype(np.float32), spacing=spacing, origin=origin) for number in numbers]


def field_of(grid: Grid) -> SampledField:
    return SampledField(grid.values, grid.holes, grid.spacing, grid.origin)


def cameras_of(grid: Grid, size: int) -> list[Camera]:
    around = orbit(grid.center, grid.bounding_radius, width=size, height=size)
    return [around[view] for view in VIEWS]


def milliseconds(call: Callable[[], object]) -> float:
    return 1e3 * min(processor_seconds(call) for _ in range(CALLS))


def drawn(caster: VolumeCaster | SurfaceCaster, cameras: Sequence[Camera]) -> Images:
    return np.stack([caster.draw(camera, threads=1) for camera in cameras])


def volumes(grids: Sequence[Grid], appearance: VolumeRendering, size: int) -> str:
    """A table: by sample distance the error, the difference from VTK and the time of an image, means over members."""
    rows = []
    for share in SPACINGS:
        found = []
        for grid in grids:
            cameras, field, distance = cameras_of(grid, size), field_of(grid), share * min(grid.spacing)
            made = VolumeCaster.of(field, appearance, sample_distance=distance, threads=1)
            finest = VolumeCaster.of(field, appearance, sample_distance=FINEST * min(grid.spacing), threads=1)
            images = drawn(made, cameras)
            asked = {"sample_distance": distance, "float_output": True, "backend": "vtk"}
            vtk = np.stack(list(render_views(grid, appearance, cameras, **asked)))
            time = milliseconds(lambda made=made, cameras=cameras: drawn(made, cameras)) / len(cameras)
            found.append((psnr(images, drawn(finest, cameras)), psnr(images, vtk), time))
        errors, differences, times = np.array(found).T
        rows.append([f"{share:g}", digits(errors.min()), digits(differences.min()), digits(times.mean())])
    return table(["sample distance, spacings", "worst dB", "worst dB against VTK", "ms"], rows)


def surfaces(grid: Grid, isovalues: Sequence[float], size: int) -> str:
    """A table of the differences from VTK's images, lit and unlit, and of times."""
    cameras, rows = cameras_of(grid, size), []
    for isovalue in isovalues:
        lit = Isosurface("iso", isovalue)
        cells = []
        for surface in (lit, replace(lit, **UNLIT)):
            ours = drawn(SurfaceCaster.of(field_of(grid), surface), cameras)
            vtk = np.stack(list(render_views(grid, surface, cameras, float_output=True, backend="vtk")))
            cells.append(digits(psnr(ours, vtk)))
        prepared = milliseconds(lambda lit=lit: SurfaceCaster.of(field_of(grid), lit))
        caster = SurfaceCaster.of(field_of(grid), lit)
        time = milliseconds(lambda caster=caster: drawn(caster, cameras)) / len(cameras)
        rows.append([f"{isovalue:g}", *cells, digits(prepared), digits(time)])
    return table(["isovalue", "dB", "dB, unlit", "triangles, ms", "an image, ms"], rows)


@click.command(help=__doc__)
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--members", "numbers", default="0,37,111", help="Members, by number; the second one's isosurfaces.")
@click.option("--isovalues", default="1.5,2.5,3.2")
@click.option("--size", default=256, help="Pixels along each side.")
def main(file: Path, numbers: str, isovalues: str, size: int) -> None:
    (appearance,) = Scene.load(PROJECT / "scenes" / "cloverleaf.toml").appearances
    assert isinstance(appearance, VolumeRendering)
    grids = members(file, [int(number) for number in numbers.split(",")])
    prepared = milliseconds(lambda: VolumeCaster.of(field_of(grids[0]), appearance, threads=1))
    print(f"{instruction_sets()[0]}, one thread; preparing a field and a function: {digits(prepared)} ms\n")
    print(volumes(grids, appearance, size))
    print(surfaces(grids[min(1, len(grids) - 1)], [float(value) for value in isovalues.split(",")], size))


if __name__ == "__main__":
    main()
