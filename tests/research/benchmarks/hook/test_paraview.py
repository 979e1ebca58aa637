"""ParaView is asked for what the hook draws, and where it is absent or fails, that is said."""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.vocabulary.cameras import Camera, orbit
from insitu.ensembles.estimate import SHEETS, waves
from render.datasets import to_grid
from render.window import open_window
from research.benchmarks.hook import pvbatch_views
from research.benchmarks.hook.paraview import (
    SCREEN,
    WAYS,
    TimedViews,
    Way,
    command_of,
    errors,
    main,
    pinhole,
    request_of,
    row,
    step_of_paraview,
    time_views,
)

HAS_PARAVIEW = shutil.which("pvbatch") and (os.environ.get("DISPLAY") or shutil.which("xvfb-run"))
VIEWS = orbit((0.0, 0.0, 0.0), 3**0.5, width=32, height=32)[20:22]


def program(folder: Path, name: str, script: str = "") -> str:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


def test_without_paraview_nothing_is_drawn_and_the_remedy_is_said() -> None:
    done = CliRunner().invoke(main, ["--pvbatch", "/nowhere/pvbatch"])
    assert done.exit_code == 1
    assert "/nowhere/pvbatch is not there" in done.output
    assert "apt-get install paraview" in done.output
    assert "--pvbatch PATH" in done.output


def test_pvbatch_gets_a_virtual_display_where_there_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pvbatch, xvfb = program(tmp_path, "pvbatch"), program(tmp_path, "xvfb-run")
    launcher, request = tmp_path / "launcher.py", tmp_path / "request.json"
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("DISPLAY", raising=False)
    plain = [pvbatch, str(launcher), str(request)]
    assert command_of("pvbatch_views", launcher, request, "pvbatch") == [xvfb, "-a", "-s", SCREEN, *plain]
    (tmp_path / "xvfb-run").unlink()
    assert command_of("pvbatch_views", launcher, request, "pvbatch") == plain
    program(tmp_path, "xvfb-run")
    monkeypatch.setenv("DISPLAY", ":0")
    assert command_of("pvbatch_views", launcher, request, "pvbatch") == plain
    assert command_of("hook_views", launcher, request, "absent") == [sys.executable, *plain[1:]]


def test_the_last_words_of_a_process_that_fails_are_shown(tmp_path: Path) -> None:
    pvbatch = program(tmp_path, "pvbatch", "echo 'bad X server connection' >&2; exit 3")
    request = request_of(WAYS[0], 8, 32, VIEWS, tmp_path)
    with pytest.raises(click.ClickException, match=r"(?s)GPU Based ended with 3.*bad X server connection"):
        time_views(WAYS[0], request, tmp_path, pvbatch)
    silent = program(tmp_path, "silent")
    with pytest.raises(click.ClickException, match="GPU Based ended with 0"):
        time_views(WAYS[0], request, tmp_path, silent)


@pytest.mark.parametrize("camera", VIEWS)
def test_a_pinhole_in_paraviews_words_sees_the_same(camera: Camera) -> None:
    said = json.loads(json.dumps(pinhole(camera)))
    again = Camera.look_at(
        said["position"], said["target"], vertical_fov_degrees=said["angle"], width=32, height=32, up=said["up"]
    )
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    np.testing.assert_allclose(again.project(points)[0], camera.project(points)[0], atol=1e-9)


def test_a_camera_that_paraview_lacks_is_refused() -> None:
    camera = Camera(VIEWS[0].world_to_camera, 40.0, 40.0, 15.0, 16.0, 32, 32)
    with pytest.raises(ValueError, match="look at the image's centre"):
        pinhole(camera)


def test_only_the_ways_at_paraviews_step_are_given_one(tmp_path: Path) -> None:
    steps = {way.name: request_of(way, 128, 32, VIEWS, tmp_path)["step"] for way in WAYS}
    given = [name for name, step in steps.items() if step is not None]
    assert given == ["hook, vtk, ParaView's step", "hook, cpu, ParaView's step"]
    assert steps[given[0]] == pytest.approx(0.5 * 2 / 127)


@pytest.mark.parametrize("size", [16, 64, 128])
def test_the_step_is_that_which_vtk_takes(size: int) -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkVolume
    from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper
    from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper  # noqa: F401 for the other's image

    window = open_window()  # which loads the classes that draw
    image, values, spacing = vtkImageData(), waves(size, 1.0), 2.0 / (size - 1)
    image.SetDimensions(size, size, size)
    image.SetSpacing(spacing, spacing, spacing)
    image.GetPointData().SetScalars(numpy_to_vtk(values.reshape(-1)))
    mapper, volume, renderer = vtkFixedPointVolumeRayCastMapper(), vtkVolume(), vtkRenderer()
    mapper.SetInputData(image)
    mapper.LockSampleDistanceToInputSpacingOn()  # as ParaView's mapper has it
    mapper.AutoAdjustSampleDistancesOff()
    volume.SetMapper(mapper)
    renderer.AddVolume(volume)
    renderer.ResetCamera()
    window.add(renderer)
    try:
        window.draw(renderer, 8, 8)
    finally:
        window.remove(renderer)
    assert step_of_paraview(size) == pytest.approx(mapper.GetSampleDistance() / spacing, rel=1e-5)


def test_the_scene_of_pvbatch_has_the_fields_place_and_function(tmp_path: Path) -> None:
    request = request_of(WAYS[2], 9, 32, VIEWS, tmp_path)
    made: dict[str, Any] = {}

    def maker(name: str) -> Any:
        return lambda *_, **settings: made.setdefault(name, SimpleNamespace(**settings))

    names = ["ImageReader", "CreateView", "Show", "ColorBy", "GetColorTransferFunction", "GetOpacityTransferFunction"]
    view = pvbatch_views.scene(SimpleNamespace(**{name: maker(name) for name in names}), request)
    reader, volume = made["ImageReader"], made["Show"]
    assert (reader.DataExtent, reader.DataOrigin) == ([0, 8] * 3, [-1.0] * 3)
    assert reader.DataSpacing == [0.25] * 3
    assert made["GetColorTransferFunction"].RGBPoints[:8] == [-1.0, 0.1, 0.2, 0.9, 0.0, 0.9, 0.9, 0.9]
    assert made["GetOpacityTransferFunction"].Points[:6] == [-1.0, 0.7, 0.5, 0.0, 0.0, 0.0]
    assert volume.ScalarOpacityUnitDistance == SHEETS.transfer_function.opacity_unit_distance
    assert (volume.VolumeRenderingMode, volume.Shade) == ("Ray Cast Only", 0)
    assert view.ViewSize == [32, 32]


def test_opaque_images_are_measured_by_color_alone() -> None:
    references = np.zeros((1, 2, 2, 4), dtype=np.float32)
    images = references.copy()
    images[..., 3] = 0.1
    with_alpha, color = errors(images, references, True)
    assert (with_alpha, color) == (pytest.approx(10 * np.log10(400)), np.inf)
    assert errors(images, references, False) == (None, np.inf)


def test_the_first_view_counts_as_the_rest() -> None:
    runs = [TimedViews((0.5, 0.02, 0.03, 0.04), 3.0, 2 / 9), TimedViews((0.7, 0.03, 0.03, 0.05), 3.2, 2 / 9)]
    cells = row(10, 32, WAYS[-1], runs, ["55.0", "56.0", "1.0"])
    assert cells == ["10³", "32²", "hook, cpu", "1", "30.0", "55.0", "56.0", "1.0", "3.00"]


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS[3:], ids=lambda way: way.name)
def test_the_hooks_ways_draw_the_requests_views(way: Way, tmp_path: Path) -> None:
    from catalogs.files.images import read_image
    from tests.support.raymarch import march

    waves(16, 1.0).tofile(tmp_path / "16.raw")
    result = time_views(way, request_of(way, 16, 32, VIEWS, tmp_path), tmp_path, "absent")
    assert len(result.views) == len(VIEWS)
    assert 0 < sum(result.views) < result.whole
    grid = to_grid(waves(16, 1.0), spacing=2 / 15, origin=(-1.0,) * 3)
    for number, camera in enumerate(VIEWS):
        image = read_image(tmp_path / f"{number}.png", dtype="float32")
        with_alpha, _ = errors(image, march(grid, SHEETS, camera, 1 / 60), True)
        assert with_alpha is not None
        assert with_alpha > 48.5


@pytest.mark.slow
@pytest.mark.skipif(not HAS_PARAVIEW, reason="ParaView's pvbatch, or a display for it, is not installed")
def test_all_ways_draw_the_same_views() -> None:
    done = CliRunner().invoke(main, ["--sizes", "32", "--pixels", "64", "--views", "2", "--runs", "1"])
    assert done.exit_code == 0, done.output
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in done.output.splitlines() if "| 32³" in line]
    assert [cells[2] for cells in rows] == [way.name for way in WAYS]
    assert all(float(cells[6]) > 40 for cells in rows), done.output
    assert [cells[5] == "opaque" for cells in rows] == [not way.settings["alpha"] for way in WAYS]
    assert all(float(cells[5]) > 40 for cells in rows if cells[5] != "opaque"), done.output
    assert "ParaView" in done.output
