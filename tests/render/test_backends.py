"""Backends: their choice, and that their pictures are the same."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from catalogs.vocabulary.appearance import ImportedImages, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from native import threads
from render import backends, casting, render_views
from render.backends import backend_of
from render.datasets import to_grid
from render.grids import Grid
from render.quality import psnr

SHEETS = TransferFunction(
    ((-1.0, 0.1, 0.2, 0.9), (0.0, 0.9, 0.9, 0.9), (1.0, 0.9, 0.1, 0.0)), ((-1.0, 0.7), (0.0, 0.0), (1.0, 0.7)), 0.2
)


def field(kind: str) -> tuple[Grid, TransferFunction]:
    """A field of waves that fade outwards, 40 x 36 x 32 samples, made hard in a way, and its transfer function."""
    axes = (np.linspace(-1.0, 1.0, n) for n in (32, 36, 40))
    z, y, x = np.meshgrid(*axes, indexing="ij")
    values = (np.sin(6 * x) * np.cos(5 * y) + np.sin(4 * z)) / 2 * np.exp(-(x**2 + y**2 + z**2))
    spacing, transfer = np.array([2 / 39, 2 / 35, 2 / 31]), SHEETS
    if kind == "holes":
        values[8:20, 10:22, 12:30], values[25, 25, 25] = np.nan, np.inf
    if kind == "thin":
        values, spacing = np.ascontiguousarray(values[::4]), spacing * [1, 1, 0.05]
        transfer = replace(transfer, opacity_unit_distance=0.01)
    if kind == "offset":
        values, transfer = 1e-3 * values + 1e9, moved(transfer, 1e-3, 1e9)
    if kind == "tiny box":
        spacing, transfer = 1e-9 * spacing, replace(transfer, opacity_unit_distance=2e-10)
    return to_grid(values, spacing=spacing, origin=-0.5 * spacing * values.shape[::-1], nan="transparent"), transfer


def moved(transfer: TransferFunction, scale: float, offset: float) -> TransferFunction:
    colors = tuple((scale * v + offset, *color) for v, *color in transfer.color_points)
    opacities = tuple((scale * v + offset, o) for v, o in transfer.opacity_points)
    return TransferFunction(colors, opacities, transfer.opacity_unit_distance)


def off_centre(camera: Camera) -> Camera:
    return replace(camera, cx=camera.cx + 11.3, cy=camera.cy - 7.1, fx=1.4 * camera.fx)


@pytest.mark.parametrize("step", [0.5, 1.5])
@pytest.mark.parametrize("shaded", [False, True])
@pytest.mark.parametrize("kind", ["ordinary", "holes", "thin", "offset", "tiny box"])
def test_volumes_are_the_same_at_the_same_steps(kind: str, shaded: bool, step: float) -> None:
    grid, transfer = field(kind)
    around = orbit(grid.center, grid.bounding_radius, width=96, height=80)
    cameras = [around[20], off_centre(around[130]), around[75]]
    asked = {"sample_distance": step * min(grid.spacing), "float_output": True}
    ours, theirs = (
        np.stack(list(render_views(grid, VolumeRendering("v", transfer, shaded), cameras, **asked, backend=backend)))
        for backend in ("cpu", "vtk")
    )
    assert theirs[..., 3].max() > 0.3
    assert psnr(ours, theirs) > 80


def test_isosurfaces_are_nearly_the_same() -> None:
    grid, _ = field("ordinary")
    cameras = orbit(grid.center, grid.bounding_radius, width=96, height=80)[20:220:70]
    ours, theirs = (
        np.stack(list(render_views(grid, Isosurface("i", 0.2), cameras, float_output=True, backend=backend)))
        for backend in ("cpu", "vtk")
    )
    assert theirs[..., 3].max() == 1
    assert psnr(ours, theirs) > 60


def test_pictures_in_bytes_are_the_floats_rounded_for_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    grid, transfer = field("ordinary")
    cameras = orbit(grid.center, grid.bounding_radius, width=70, height=50)[20:220:90]
    pictures = []
    for limit in ("0", "1", "3"):
        monkeypatch.setenv("LP_NUM_THREADS", limit)
        pictures.append(np.stack(list(render_views(grid, VolumeRendering("v", transfer), cameras))))
    floats = np.stack(list(render_views(grid, VolumeRendering("v", transfer), cameras, float_output=True)))
    np.testing.assert_array_equal(pictures[0], pictures[1])
    np.testing.assert_array_equal(pictures[0], pictures[2])
    assert pictures[0].dtype == np.uint8
    assert np.abs(255.0 * floats - pictures[0]).max() <= 0.5 + 1e-4


def test_threads_are_those_that_the_environment_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    for limit, expected in {"0": 1, "1": 1, "3": 3, "": 5, "many": 5}.items():
        monkeypatch.setenv("LP_NUM_THREADS", limit)
        with threads.kernel_threads(5):
            assert casting.drawing_threads() == expected


def test_volumes_are_cast_and_isosurfaces_are_left_to_vtk() -> None:
    grid, transfer = field("ordinary")
    volume, surface = VolumeRendering("v", transfer), Isosurface("i", 0.2)
    assert [backend_of(grid, a) for a in (volume, surface, ImportedImages("n"))] == ["cpu", "vtk", ""]
    assert [backend_of(grid, a, "cpu") for a in (volume, surface)] == ["cpu", "cpu"]
    assert [backend_of(grid, a, "vtk") for a in (volume, surface)] == ["vtk", "vtk"]
    assert [backend_of(grid, volume, wanted, "vtk") for wanted in ("auto", "cpu")] == ["vtk", "cpu"]
    with pytest.raises(ValueError, match=r"backend must be one of .*got 'gpu'"):
        backend_of(grid, volume, "gpu")


@pytest.mark.parametrize("reason", ["size", "kernels"])
def test_vtk_draws_what_the_ray_caster_cannot(reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    grid, transfer = field("ordinary")
    if reason == "size":
        monkeypatch.setattr(backends, "MOST_SAMPLES", 42 * 38 * 34 - 1)
    else:
        monkeypatch.setitem(sys.modules, "native", None)
    volume = VolumeRendering("v", transfer)
    assert backend_of(grid, volume) == backend_of(grid, volume, usual="cpu") == "vtk"
    with pytest.raises(ValueError, match=r"backend 'cpu' can't draw this field: .*; backend 'vtk' can"):
        backend_of(grid, volume, "cpu")


def test_volumes_of_arrays_are_drawn_without_loading_vtk_or_torch() -> None:
    program = (
        "import sys, numpy, insitu, tempfile\n"
        "look = insitu.VolumeRendering('v', insitu.TransferFunction(((0, 1, 0, 0), (1, 0, 0, 1)), ((0, 0), (1, 1)), 1))\n"
        "field = numpy.random.default_rng(0).random((8, 8, 8), dtype='f4')\n"
        "with tempfile.TemporaryDirectory() as folder:\n"
        "    done = insitu.render_member(field, {'a': 0.5}, catalog=folder + '/a.cdb', space={'a': (0, 1)}, appearances=look,\n"
        "                                views=insitu.ViewPlan(1, 16, 16), spacing=(1, 1, 1))\n"
        "print(done.images, [name for name in ('vtkmodules', 'torch') if name in sys.modules])\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert result.stdout.strip() == "12 []", result.stdout + result.stderr
