"""Measure rendering and write docs/results/rendering.md and docs/results/rendering.png.

    LP_NUM_THREADS=0 python -m research.benchmarks.rendering.accuracy [--machine "two shared cores"] [--parts hard]

Errors do not depend on the machine; times do.  About five minutes of one core, most of them for the float64
reference, then half a minute of two.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from catalogs.vocabulary.scene import Scene
from render import Grid, choose_sample_distance, render_views, to_grid
from render.isosurface import SUPERSAMPLING, extract
from render.placement import Placement
from render.quality import psnr
from render.views import Renderer
from render.volume import image_data
from render.window import aim, open_window
from research.benchmarks.page import PROJECT, RESULTS, command_line, made_by, stopwatch, table, titled, write_parts
from research.benchmarks.rendering.hard_inputs import hard_inputs
from research.benchmarks.splatting.figures import panels
from research.benchmarks.timing import processor_seconds
from tests.support.raymarch import converged

PAGE, FIGURE = RESULTS / "rendering.md", RESULTS / "rendering.png"
SCENE = PROJECT / "scenes" / "tgv-dvr.toml"
SPACINGS = (2.0, 1.5, 1.0, 0.8, 0.7, 0.6, 0.5, 0.35, 0.25, 0.125)  # sample distances, in grid spacings
VIEWS = (20, 75, 140)  # of 252: from near the top, obliquely, from the side
HALF_STEP = ("//VTK::Base::Init", "//VTK::Base::Init\n  g_rayOrigin -= 0.5 * g_dirStep;\n")
BLOBS = ((30, 30, 30), (12, 44, 20), (46, 14, 45), (14, 13, 46))  # (x, y, z) of 61³ samples
SAMPLES, FINEST = (1, 2, 3, 4, 8), 16  # along each side of a pixel, of isosurfaces
VARIANTS = ("VTK", "VTK, half step", "this package")

Draw = Callable[[Camera], NDArray[Any]]
Found = dict[str, list[tuple[float, float, float]]]  # per variant: sample distance in spacings, dB, ms


# ---- scenes ----------------------------------------------------------------------------------------------------


@cache
def member(resolution: int = 64) -> Grid:
    """Q of the Taylor-Green vortex at Re 2000, t = 5, as the default scene renders it."""
    from insitu.simulations import simulation

    field = simulation("taylor_green").run({"Re": 2000.0}, resolution=resolution, time=5.0)
    return to_grid(field.values, spacing=field.spacing, origin=field.origin)


def appearances() -> dict[str, VolumeRendering]:
    """The default scene's smooth transfer function, and one with two narrow peaks."""
    smooth = next(a for a in Scene.load(SCENE).appearances if isinstance(a, VolumeRendering))
    peaks = ((-6.0, 0.0), (-4.0, 0.5), (-2.0, 0.0), (3.0, 0.0), (6.0, 0.8), (9.0, 0.0))
    colors = smooth.transfer_function.color_points
    return {"smooth": smooth, "narrow peaks": VolumeRendering("peaks", TransferFunction(colors, peaks, 0.45))}


def cameras(grid: Grid, size: int = 256) -> list[Camera]:
    return orbit(grid.center, grid.bounding_radius, width=size, height=size)


# ---- VTK's own volume mapper, for comparison ---------------------------------------------------------------------


class StockVolume:
    """A volume by VTK's own mapper: tabulated transfer functions, optionally a half-step start."""

    def __init__(self, grid: Grid, appearance: VolumeRendering, distance: float, half_step: bool) -> None:
        from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
        from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkRenderer, vtkVolume, vtkVolumeProperty
        from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper

        transfer, self._placement = appearance.transfer_function, Placement.of(grid)
        colors, opacities = vtkColorTransferFunction(), vtkPiecewiseFunction()
        for color in transfer.color_points:
            colors.AddRGBPoint(*color)
        for point in transfer.opacity_points:
            opacities.AddPoint(*point)
        form = vtkVolumeProperty()
        form.SetColor(colors)
        form.SetScalarOpacity(opacities)
        form.SetScalarOpacityUnitDistance(transfer.opacity_unit_distance / self._placement.scale)
        form.SetInterpolationTypeToLinear()
        mapper = vtkOpenGLGPUVolumeRayCastMapper()
        mapper.SetInputData(image_data(np.clip(grid.values, *transfer.bounds)[..., None], self._placement))
        mapper.SetAutoAdjustSampleDistances(False)
        mapper.SetSampleDistance(distance / self._placement.scale)
        volume = vtkVolume()
        volume.SetMapper(mapper)
        volume.SetProperty(form)
        if half_step:
            volume.GetShaderProperty().AddFragmentShaderReplacement(HALF_STEP[0], True, HALF_STEP[1], False)
        self._renderer = vtkRenderer()
        self._renderer.AddVolume(volume)
        open_window().add(self._renderer)

    def render(self, camera: Camera) -> NDArray[Any]:
        local = self._placement.camera(camera)
        aim(self._renderer, local, *self._placement.clipping_range(local))
        return open_window().draw(self._renderer, camera.width, camera.height)

    def close(self) -> None:
        open_window().remove(self._renderer)


# ---- measurements ----------------------------------------------------------------------------------------------


def speed_against_error(appearance: VolumeRendering) -> Found:
    """(sample distance in spacings, dB over all views pooled, processor ms per image) per variant."""
    grid = member()
    views = [cameras(grid)[v] for v in VIEWS]
    truth = np.stack([converged(grid, appearance, camera, tolerance=2e-4)[0] for camera in views])
    results: Found = {variant: [] for variant in VARIANTS}
    for fraction in SPACINGS:
        distance = fraction * min(grid.spacing)
        for variant in VARIANTS:
            if variant == VARIANTS[2]:
                volume: Any = Renderer(grid, appearance, sample_distance=distance)
            else:
                volume = StockVolume(grid, appearance, distance, half_step=variant == VARIANTS[1])
            images = np.stack([volume.render(camera) for camera in views])
            results[variant].append((fraction, psnr(images / 255.0, truth), processor_ms(volume.render, views)))
            volume.close()
    return results


def processor_ms(draw: Draw, views: Sequence[Camera], repeats: int = 3) -> float:
    """Processor milliseconds per image, the best of a few rounds."""
    rounds = [processor_seconds(lambda: [draw(camera) for camera in views]) for _ in range(repeats)]
    return min(rounds) * 1e3 / len(views)


def throughput(processes: int) -> tuple[float, float]:
    """(images per second over all processes, target dB) for 252 views of a 64³ member each, set-up included."""
    context = multiprocessing.get_context("spawn")
    ready, go = context.Barrier(processes + 1), context.Event()
    done = context.Queue()
    workers = [context.Process(target=_member_of_252, args=(ready, go, done)) for _ in range(processes)]
    for worker in workers:
        worker.start()
    ready.wait()
    started = time.perf_counter()
    go.set()
    decibels = [done.get() for _ in workers]
    seconds = time.perf_counter() - started
    for worker in workers:
        worker.join()
    return 252 * processes / seconds, decibels[0]


def _member_of_252(ready: Any, go: Any, done: Any) -> None:
    grid, appearance = member(), appearances()["smooth"]
    chosen = choose_sample_distance(grid, appearance, cameras(grid), Scene.load(SCENE).render.target_decibels)
    ready.wait()
    go.wait()
    for _ in render_views(grid, appearance, cameras(grid), sample_distance=chosen.distance, backend="vtk"):
        pass
    done.put(chosen.decibels)


def isosurface_row(resolution: int) -> list[str]:
    grid, appearance = member(resolution), Isosurface("cores", 5.0)
    seconds = [processor_seconds(lambda: Renderer(grid, appearance)) for _ in range(3)]
    surface, triangles = Renderer(grid, appearance), extract(grid, 5.0, Placement.of(grid)).GetNumberOfPolys()
    views = [cameras(grid)[v] for v in VIEWS]
    row = [f"{resolution}³", f"{triangles:,}", f"{min(seconds) * 1e3:.0f}"]
    return [*row, f"{processor_ms(surface.render, views):.1f}"]


def smoothness() -> list[tuple[int, float, float]]:
    """For each of `SAMPLES`: samples along each side of a pixel, PSNR (dB) on white, and processor ms per image."""
    grid, appearance = member(), Isosurface("cores", 5.0)
    views = [cameras(grid)[v] for v in VIEWS]

    def pictures(n: int) -> NDArray[Any]:
        """All views on white, [V, H, W, 3]."""
        with Renderer(grid, appearance, samples=n) as surface:
            drawn = np.stack([surface.render(view, float_output=True) for view in views])
        return np.asarray(drawn[..., :3] + (1.0 - drawn[..., 3:]))

    finest, rows = pictures(FINEST), []
    for n in SAMPLES:
        with Renderer(grid, appearance, samples=n) as surface:
            rows.append((n, psnr(pictures(n), finest), processor_ms(surface.render, views)))
    return rows


def volume_projection_error(transform: Callable[[Camera], Camera] = lambda camera: camera) -> float:
    """Largest distance in pixels, over 48 images at 256², between the centroid of a faint blob and its projection.

    The blob is thin enough for alpha to add up. The centroid of its image is therefore the mean of the projected
    samples, each weighted by its pixel area along a ray, 1 / (depth² cos(angle off the axis)).
    """
    thin = TransferFunction(((0, 1, 1, 1), (1, 1, 1, 1)), ((0.0, 0.0), (1.0, 0.002)), 0.05)
    worst = 0.0
    for position in BLOBS:
        k, j, i = np.indices((61, 61, 61))
        squared = (i - position[0]) ** 2 + (j - position[1]) ** 2 + (k - position[2]) ** 2
        grid = to_grid(np.exp(-squared / 4.5), spacing=1 / 60, origin=(2.0, 3.0, 4.0))
        lit = grid.values > 1e-6
        points = np.stack([i[lit], j[lit], k[lit]], axis=1) / 60 + grid.origin  # [N, 3]
        views = [transform(camera) for camera in cameras(grid)[::21]]
        pictures = render_views(
            grid, VolumeRendering("dot", thin), views, sample_distance=1 / 200, float_output=True, backend="vtk"
        )
        for camera, picture in zip(views, pictures, strict=True):
            pixels, depth = camera.project(points)
            weights = grid.values[lit] * np.linalg.norm(points - camera.position, axis=1) / depth**3
            expected = weights @ pixels / weights.sum()
            worst = max(worst, float(np.linalg.norm(centroid(picture) - expected)))
    return worst


def isosurface_projection_errors(transform: Callable[[Camera], Camera] = lambda camera: camera) -> NDArray[np.float64]:
    """Offsets (V, 2) in pixels, over 48 images at 256², between a ball's centroid and its ellipse's centre.

    The outline of a sphere of radius r at (x, y, z) in camera axes is an ellipse centred at (x z, y z) / (z² - r²). The
    outline is sampled 16 times per pixel.
    """
    offsets, radius = [], 0.3
    for position in BLOBS:
        k, j, i = np.indices((61, 61, 61)) / 60
        center = (18 + 2 * np.array(position) // 5) / 60
        squared = (i - center[0]) ** 2 + (j - center[1]) ** 2 + (k - center[2]) ** 2
        grid = to_grid(np.sqrt(squared), spacing=1 / 60)
        views = [transform(camera) for camera in cameras(grid)[::21]]
        pictures = render_views(grid, Isosurface("ball", radius), views, float_output=True)
        for camera, picture in zip(views, pictures, strict=True):
            x, y, z = camera.rotation @ center + camera.world_to_camera[:3, 3]
            middle = np.array([x, y]) * z / (z**2 - radius**2) * [camera.fx, camera.fy] + [camera.cx, camera.cy]
            offsets.append(centroid(picture) - middle)
    return np.array(offsets)


def centroid(picture: NDArray[Any]) -> NDArray[np.float64]:
    """Alpha-weighted mean pixel position (x, y) of a picture [H, W, 4]."""
    alpha = picture[..., 3].astype(np.float64)
    rows, columns = np.indices(alpha.shape) + 0.5
    return np.array([(columns * alpha).sum(), (rows * alpha).sum()]) / alpha.sum()


# ---- the page ------------------------------------------------------------------------------------------------------


def error_table(results: Found) -> str:
    header = ["sample distance / spacing", *(f"{variant}: dB, ms" for variant in VARIANTS)]
    rows = []
    for number, fraction in enumerate(SPACINGS):
        cells = [f"{results[v][number][1]:.1f}, {results[v][number][2]:.0f}" for v in VARIANTS]
        rows.append([f"{fraction:g}", *cells])
    return table(header, rows)


def figure(results: dict[str, Found]) -> None:
    with panels(FIGURE, len(results), width=5.5, height=4.2) as drawn:
        for axes, (name, variants) in zip(drawn, results.items(), strict=True):
            for variant, style in zip(VARIANTS, ("o--", "s--", "d-"), strict=True):
                fractions, decibels, milliseconds = zip(*variants[variant], strict=True)
                axes.semilogx(milliseconds, decibels, style, label=variant, markersize=4)
                for fraction, decibel, ms in zip(fractions, decibels, milliseconds, strict=True):
                    if variant != VARIANTS[1] and fraction in (2.0, 1.0, 0.5, 0.25, 0.125):
                        at = {"xytext": (3, -8), "textcoords": "offset points"}
                        axes.annotate(f"{fraction:g}", (ms, decibel), fontsize=7, **at)
            axes.axhline(50, color="k", linewidth=0.6)
            axes.sharey(drawn[0])
            axes.set(xlabel="processor ms per 256² image", title=f"64³, {name}")
        drawn[0].set_ylabel("dB against the float64 ray-marcher")
        drawn[0].legend()
        drawn[0].figure.suptitle("Speed against error; labels: sample distance in grid spacings", fontsize=10)


def main() -> None:
    parser = command_line("rendering.accuracy", __doc__)
    parser.add_argument("--machine", default=f"{os.cpu_count()} cores", help="written beside the results")
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS), help="those to measure")
    arguments = parser.parse_args()
    machine = arguments.machine
    os.environ.setdefault("LP_NUM_THREADS", "0")  # one thread per process, before the driver starts
    on, folders = (
        f"{machine} ({open_window().backend})",
        ("render", "catalogs", "insitu", "research/benchmarks/rendering/accuracy.py"),
    )
    made = made_by("rendering.accuracy", *folders, on=on, environment="LP_NUM_THREADS=0 ")
    results: dict[str, Found] = {}
    parts = {name: partial(part, results) for name, part in PARTS.items() if name in arguments.parts}
    failed = write_parts(PAGE, parts, made, stopwatch())
    if set(results) == set(appearances()):
        figure(results)
    sys.exit(bool(failed))


def speed_part(name: str, results: dict[str, Found]) -> str:
    results[name] = speed_against_error(appearances()[name])
    return titled(
        f"Speed against error, {name} (dB over three views; processor ms per image)", error_table(results[name])
    )


def throughput_part(_: dict[str, Found]) -> str:
    rows = []
    for processes in (1, 2):
        rate, decibels = throughput(processes)
        rows.append([str(processes), f"{rate:.0f}", f"{decibels:.1f}"])
    title = "252 views of a 64³ member at 256², at the default scene's sample distance, upload included"
    return titled(title, table(["processes of one thread", "images/s, all together", "dB"], rows))


def isosurface_part(_: dict[str, Found]) -> str:
    header = ["grid", "triangles", "extraction, ms", "per 256² image, ms"]
    speed = titled("Isosurface Q = 5 (processor time)", table(header, [isosurface_row(n) for n in (64, 128)]))
    header = ["samples per pixel", "PSNR on white, dB", "per 256² image, processor ms"]
    rows = [
        [f"{n} x {n}{' (ours)' if n == SUPERSAMPLING else ''}", f"{decibels:.1f}", f"{ms:.1f}"]
        for n, decibels, ms in smoothness()
    ]
    error = titled(f"Isosurface Q = 5, 64³: edges against those of {FINEST} x {FINEST} samples", table(header, rows))
    return f"{speed}\n\n{error}"


def centroid_part(_: dict[str, Found]) -> str:
    balls = isosurface_projection_errors()
    mean, largest = np.linalg.norm(balls.mean(axis=0)), np.linalg.norm(balls, axis=1).max()
    rows = [["volume: faint blob", "", f"{volume_projection_error():.4f}"]]
    rows.append(["isosurface: ball", f"{mean:.4f}", f"{largest:.4f}"])
    title = "Centroids against the pinhole camera, pixels, over 48 pictures at 256²"
    return titled(title, table(["", "mean offset", "largest offset"], rows))


def hard_part(_: dict[str, Found]) -> str:
    grid = member()
    header = ["field, float64", "volume, dB", "lit volume, dB", "isosurface, dB"]
    title = "Hard inputs: volumes against the float64 ray-marcher at the same steps, isosurfaces against the field's as it is"
    return titled(
        title,
        table(header, hard_inputs(grid, appearances()["smooth"].transfer_function, cameras(grid, size=48)[VIEWS[1]])),
    )


PARTS: Mapping[str, Callable[[dict[str, Found]], str]] = {
    "smooth": lambda found: speed_part("smooth", found),
    "peaks": lambda found: speed_part("narrow peaks", found),
    "throughput": throughput_part,
    "isosurface": isosurface_part,
    "centroids": centroid_part,
    "hard": hard_part,
}


if __name__ == "__main__":
    main()
