"""Processor time and error of ParaView's batch renderer beside the hook's.

    python -m research.benchmarks.hook.paraview [--sizes 64,128] [--pixels 256,512] [--views 12] [--runs 2]
        [--pvbatch PATH] [--write]

pvbatch and the hook's backends draw one field of smooth waves from the same cameras with one transfer function.  Each does so in
a process and a thread of its own.  A view is a camera that is set, an image that is drawn, and its PNG.  Errors are those of the
PNG files, against images with steps of an eighth of a spacing in single precision.  `--write` puts the table into
docs/results/hook.md.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import read_image
from catalogs.vocabulary.cameras import Camera
from insitu.ensembles.estimate import SHEETS, waves
from render.casting import cast_views, prepared
from render.datasets import to_grid
from render.grids import Grid
from render.quality import psnr, spread
from research.benchmarks.hook.hook_views import fields_of, plan_of
from research.benchmarks.hook.shares import whole_numbers
from research.benchmarks.page import PROJECT, RESULTS, made_by, publish, table
from research.benchmarks.timing import digits
from tests.support.raymarch import march

FINEST = 1 / 8  # spacings between samples of the reference
CHECKED_PIXELS = 48
ORIGIN = -1.0
FOLDERS = ("catalogs", "native", "render", "insitu", "research/benchmarks/hook")
# A server that resets when its last client leaves refuses the next one meanwhile, which pvbatch is itself.
SCREEN = "-screen 0 1280x1024x24 -noreset"
LAUNCHER = "import sys\nfrom research.benchmarks.hook.{module} import draw\ndraw(sys.argv[1])\n"
REMEDY = (
    "install ParaView with it (Debian: apt-get install paraview python3-paraview xvfb xauth) or pass --pvbatch PATH"
)
COLUMNS = [
    "field",
    "images",
    "drawn by",
    "step, spacings",
    "ms a view",
    "dB",
    "dB of colour",
    "kB a view",
    "the rest, s",
]


@dataclass(frozen=True)
class Way:
    """A way to draw: its name, the module that does it, settings of the request, and whether the step is ParaView's."""

    name: str
    module: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    as_paraview: bool = False


WAYS = (
    Way("pvbatch, GPU Based", "pvbatch_views", {"mode": "GPU Based", "alpha": True}),
    Way("pvbatch, GPU Based, opaque", "pvbatch_views", {"mode": "GPU Based", "alpha": False}),
    Way("pvbatch, Ray Cast Only", "pvbatch_views", {"mode": "Ray Cast Only", "alpha": True}),
    Way("hook, vtk, ParaView's step", "hook_views", {"backend": "vtk", "alpha": True}, True),
    Way("hook, cpu, ParaView's step", "hook_views", {"backend": "cpu", "alpha": True}, True),
    Way("hook, vtk", "hook_views", {"backend": "vtk", "alpha": True}),
    Way("hook, cpu", "hook_views", {"backend": "cpu", "alpha": True}),
)


@dataclass(frozen=True)
class TimedViews:
    """One process's views: processor seconds of each and of the whole process, the step, and what drew them."""

    views: tuple[float, ...]
    whole: float
    step: float | None
    version: str = ""


def command_of(module: str, launcher: Path, request: Path, pvbatch: str) -> list[str]:
    """The command that draws a request; raises click.ClickException with the remedy where pvbatch is absent.

    Without a display pvbatch gets a virtual one, if there is xvfb: some builds can't do without.
    """
    if module == "hook_views":
        return [sys.executable, str(launcher), str(request)]
    program = shutil.which(pvbatch)
    if program is None:
        raise click.ClickException(f"{pvbatch} is not there: {REMEDY}")
    xvfb = None if os.environ.get("DISPLAY") else shutil.which("xvfb-run")
    virtual = [xvfb, "-a", "-s", SCREEN] if xvfb else []
    return [*virtual, program, str(launcher), str(request)]


def step_of_paraview(size: int) -> float:
    """Spacings between samples that ParaView takes for a still image of a field of `size`³.

    Half a spacing, and less below 100 samples an axis (VTK's vtkVolumeMapper::SpacingAdjustedSampleDistance).
    """
    length = float((size - 1) ** 3) ** 0.333
    return 0.5 * min(1.0, 0.01 + 0.99 * length / 100)


def request_of(way: Way, size: int, pixels: int, cameras: Sequence[Camera], folder: Path) -> dict[str, Any]:
    """All that a process must know, as JSON values."""
    transfer, spacing = SHEETS.transfer_function, 2.0 / (size - 1)
    return {
        "field": str(folder / f"{size}.raw"),
        "size": size,
        "spacing": spacing,
        "origin": ORIGIN,
        "pixels": pixels,
        "colors": [list(point) for point in transfer.color_points],
        "opacities": [list(point) for point in transfer.opacity_points],
        "unit": transfer.opacity_unit_distance,
        "cameras": [camera.to_json() for camera in cameras],
        "pinholes": [pinhole(camera) for camera in cameras],
        "step": step_of_paraview(size) * spacing if way.as_paraview else None,
        "pictures": str(folder),
        "answer": str(folder / "answer.json"),
        **way.settings,
    }


def pinhole(camera: Camera) -> dict[str, Any]:
    """A camera in ParaView's words; it must look along the axis through the image's centre, with square pixels."""
    if (camera.cx, camera.cy, camera.fx) != (camera.width / 2, camera.height / 2, camera.fy):
        raise ValueError(f"ParaView's cameras have square pixels and look at the image's centre, not so {camera}")
    return {
        "position": camera.position.tolist(),
        "target": (camera.position + camera.forward).tolist(),
        "up": camera.up.tolist(),
        "angle": camera.vertical_fov_degrees,
    }


def time_views(way: Way, request: Mapping[str, Any], folder: Path, pvbatch: str) -> TimedViews:
    """The views of one process, whose images stay in `folder`; raises click.ClickException with its last words where it fails."""
    launcher, path, answer = folder / "launcher.py", folder / "request.json", Path(request["answer"])
    launcher.write_text(LAUNCHER.format(module=way.module))
    path.write_text(json.dumps(request))
    answer.unlink(missing_ok=True)
    environment = {**os.environ, "LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1", "PYTHONPATH": str(PROJECT)}
    command, before = command_of(way.module, launcher, path, pvbatch), seconds_of_children()
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode or not answer.exists():
        words = "\n".join((done.stdout + done.stderr).strip().splitlines()[-5:])
        raise click.ClickException(f"{way.name} ended with {done.returncode}; its last words:\n{words}")
    reply = json.loads(answer.read_text())
    whole = seconds_of_children() - before
    return TimedViews(tuple(reply["views"]), whole, reply["step"], reply["version"])


def seconds_of_children() -> float:
    """Processor seconds of all processes that this one started and that ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def errors(images: NDArray[np.float32], references: NDArray[np.float32], alpha: bool) -> tuple[float | None, float]:
    """PSNR of premultiplied RGBA, None for opaque images, and of colour on black; of all pixels [V, H, W, 4] together."""
    color = psnr(images[..., :3], references[..., :3])
    return psnr(images, references) if alpha else None, color


def reference(grid: Grid, cameras: Sequence[Camera]) -> NDArray[np.float32]:
    """Images of the finest step, float32 [V, H, W, 4]."""
    return np.stack(list(cast_views(prepared(grid, SHEETS), cameras, FINEST * min(grid.spacing), float_output=True)))


def agreement(grid: Grid, camera: Camera) -> float:
    """Decibels between the reference and the float64 ray-marcher of the tests, of one small view."""
    small = camera.resized(CHECKED_PIXELS, CHECKED_PIXELS)
    return psnr(reference(grid, [small])[0], march(grid, SHEETS, small, FINEST * min(grid.spacing)))


def case(size: int, pixels: int, views: int, runs: int, pvbatch: str) -> tuple[list[list[str]], float, str]:
    """Rows of one field and image size, the agreement of the reference, and ParaView's version."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        waves(size, 1.0).tofile(folder / f"{size}.raw")
        grid = to_grid(waves(size, 1.0), spacing=2.0 / (size - 1), origin=(ORIGIN,) * 3)
        plain = request_of(WAYS[0], size, pixels, [], folder)
        paths = [folder / f"{view}.png" for view in range(views)]
        cameras = spread(plan_of(fields_of(plain), pixels, "cpu", plain["spacing"]).cameras, views)
        references = reference(grid, cameras)
        results: dict[str, list[TimedViews]] = {way.name: [] for way in WAYS}
        cells: dict[str, list[str]] = {}
        for _ in range(runs):
            for way in WAYS:
                for path in paths:
                    path.unlink(missing_ok=True)
                request = request_of(way, size, pixels, cameras, folder)
                results[way.name].append(time_views(way, request, folder, pvbatch))
                images = np.stack([read_image(path, dtype="float32") for path in paths])
                with_alpha, color = errors(images, references, way.settings["alpha"])
                kilobytes = statistics.mean(path.stat().st_size for path in paths) / 1e3
                both = ["opaque" if with_alpha is None else f"{with_alpha:.1f}", f"{color:.1f}"]
                cells[way.name] = [*both, digits(kilobytes)]
        rows = [row(size, pixels, way, results[way.name], cells[way.name]) for way in WAYS]
        return rows, agreement(grid, cameras[0]), results[WAYS[0].name][0].version


def row(size: int, pixels: int, way: Way, runs: Sequence[TimedViews], cells: Sequence[str]) -> list[str]:
    """Medians over all views but the first of each process; the rest of a process is what its views do not take."""
    view = statistics.median(seconds for run in runs for seconds in run.views[1:])
    rest = statistics.median(run.whole - sum(run.views[1:]) for run in runs)
    step = runs[0].step
    spacings = step_of_paraview(size) if step is None else step * (size - 1) / 2.0
    return [f"{size}³", f"{pixels}²", way.name, f"{spacings:.2g}", digits(1e3 * view), *cells, digits(rest)]


@click.command(help=__doc__)
@click.option("--sizes", default="64,128", callback=whole_numbers, help="Samples along each axis.")
@click.option("--pixels", default="256,512", callback=whole_numbers, help="Of an image's side.")
@click.option("--views", default=12, type=click.IntRange(2), help="Of each process.")
@click.option("--runs", default=2, type=click.IntRange(1), help="Processes of each way, in turn.")
@click.option("--pvbatch", default="pvbatch", help="ParaView's program.")
@click.option("--write", is_flag=True, help="Put the table into docs/results/hook.md.")
def main(sizes: Sequence[int], pixels: Sequence[int], views: int, runs: int, pvbatch: str, write: bool) -> None:
    command_of("pvbatch_views", Path(), Path(), pvbatch)  # before anything is drawn
    cases = [case(size, side, views, runs, pvbatch) for size in sizes for side in pixels]
    least, version = min(decibels for _, decibels, _ in cases), cases[0][2]
    body = table(COLUMNS, [line for rows, _, _ in cases for line in rows])
    words = f"--sizes {','.join(map(str, sizes))} --pixels {','.join(map(str, pixels))} --views {views} --runs {runs}"
    note = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; {version}; medians of {runs} processes of each way and of "
    note += f"their views after the first; the reference agrees with the float64 ray-marcher to {least:.0f} dB"
    made = made_by(f"hook.paraview {words}", *FOLDERS)
    publish(f"{body}\n<sub>{made}; {note}</sub>", RESULTS / "hook.md", "paraview", write=write)


if __name__ == "__main__":
    main()
