"""The machine's OpenGL: found, missing, forked, threaded; and a process that ends in peace."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from render.views import Renderer, render_views
from render.window import Window, open_window, projection_matrix

PROJECT = Path(__file__).resolve().parents[2]


def python(program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=PROJECT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


DRAW = """
import numpy as np
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import orbit
from render import render_views, to_grid
grid = to_grid(np.random.default_rng(0).random((8, 8, 8)))
transfer = TransferFunction(((0, 0, 0, 1), (1, 1, 0, 0)), ((0, 0), (1, 0.5)), 1.0)
cameras = orbit(grid.center, grid.bounding_radius, width=32, height=32, frequency=1)
print(sum(int(image.sum()) > 0 for image in render_views(grid, VolumeRendering("dvr", transfer), cameras, backend="vtk")))
"""


def test_a_fresh_process_draws_and_ends_without_a_word() -> None:
    result = python(DRAW)
    assert (result.returncode, result.stdout.strip(), result.stderr) == (0, "12", "")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL and OSMesa are Linux's")
@pytest.mark.parametrize(
    "broken",
    [{"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent"}, {"LIBGL_DRIVERS_PATH": "/nonexistent"}],
    ids=["no driver for EGL", "no software renderer"],
)
def test_missing_opengl_is_one_clear_sentence_not_a_crash(broken: dict[str, str]) -> None:
    result = python(DRAW, **broken)
    if result.returncode == 0:
        pytest.skip("this machine finds its OpenGL driver elsewhere")
    last = result.stderr.strip().splitlines()[-1]
    assert result.returncode == 1
    assert last.startswith("RuntimeError: no usable OpenGL on this machine: install the system packages libegl1 ")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL and OSMesa are Linux's")
def test_missing_libraries_are_never_handed_to_vtk(monkeypatch) -> None:
    monkeypatch.setattr("render.window._loads", lambda library: False)
    with pytest.raises(RuntimeError, match=r"libegl1 .* libosmesa6"):
        Window()


def test_there_is_one_window_per_process() -> None:
    assert open_window() is open_window()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_is_told_to_be_spawned() -> None:
    program = DRAW + (
        "import os\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    try:\n"
        "        next(render_views(grid, VolumeRendering('dvr', transfer), cameras, backend='vtk'))\n"
        "    except RuntimeError as error:\n"
        "        os._exit(7 if 'spawn' in str(error) else 8)\n"
        "    os._exit(9)\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
    )
    assert python(program).stdout.split() == ["12", "7"]


def test_any_thread_draws_what_the_first_one_draws(gyroid, smooth) -> None:
    cameras = orbit(gyroid.center, gyroid.bounding_radius, width=16, height=16, frequency=1)
    looks = VolumeRendering("dvr", smooth), Isosurface("iso", 0.2)

    def pictures() -> np.ndarray:
        return np.stack([picture for look in looks for picture in render_views(gyroid, look, cameras, backend="vtk")])

    first = pictures()
    with ThreadPoolExecutor(4) as threads:
        others = [threads.submit(pictures) for _ in range(8)]
        assert all(np.array_equal(other.result(), first) for other in others)
    assert first.any()


def test_a_renderer_may_be_handed_from_thread_to_thread(gyroid, smooth) -> None:
    camera = orbit(gyroid.center, gyroid.bounding_radius, width=16, height=16, frequency=1)[3]
    with ThreadPoolExecutor(1) as other:
        volume = other.submit(Renderer, gyroid, VolumeRendering("dvr", smooth)).result()
        here = volume.render(camera)
        assert here.any()
        assert np.array_equal(other.submit(volume.render, camera).result(), here)
        volume.close()


def test_a_process_that_drew_in_a_thread_that_ended_ends_in_peace() -> None:
    program = DRAW.rpartition("print(")[0] + (
        "import threading\n"
        "drawing = threading.Thread(target=lambda: print(len(list(render_views(\n"
        "    grid, VolumeRendering('dvr', transfer), cameras, backend='vtk')))))\n"
        "drawing.start()\n"
        "drawing.join()\n"
        "print(len(list(render_views(grid, VolumeRendering('dvr', transfer), cameras, backend='vtk'))))\n"
    )
    ended = python(program)
    assert (ended.stdout.split(), ended.returncode) == (["12", "12"], 0)


@pytest.mark.parametrize(("look", "factor"), [("volume", 1), ("surface", 4)])
def test_pictures_larger_than_opengl_draws_are_refused(gyroid, smooth, look: str, factor: int) -> None:
    longest = open_window().longest_side
    appearance = VolumeRendering("dvr", smooth) if look == "volume" else Isosurface("iso", 0.2)
    for width, height in ((longest // factor + 1, 1), (1, longest // factor + 1)):
        cameras = orbit(gyroid.center, gyroid.bounding_radius, width=width, height=height, frequency=1)
        with pytest.raises(ValueError, match=f"choose width and height up to {longest // factor}$"):
            next(render_views(gyroid, appearance, cameras, backend="vtk"))
    widest = orbit(gyroid.center, gyroid.bounding_radius, width=longest // factor, height=8, frequency=1)
    assert next(render_views(gyroid, appearance, widest, backend="vtk")).any()


def test_the_projection_matrix_is_the_pinhole_camera() -> None:
    camera = Camera(np.eye(4), 300.0, 200.0, 70.0, 55.0, 160, 120)
    points = np.random.default_rng(0).uniform((-1, -1, 2), (1, 1, 9), size=(50, 3))
    eye = np.concatenate([points * [1, -1, -1], np.ones((50, 1))], axis=1)  # OpenGL: y up, z backward
    clip = eye @ projection_matrix(camera, 1.0, 10.0).T
    device = clip[:, :3] / clip[:, 3:]
    pixels = (device[:, :2] * [1, -1] + 1) / 2 * [camera.width, camera.height]
    np.testing.assert_allclose(pixels, camera.project(points)[0], atol=1e-9)
    assert (np.abs(device[:, 2]) < 1).all()


def resident() -> float:
    """Memory of this process in MiB; skips where it can't be known."""
    statm = Path("/proc/self/statm")
    if not statm.exists():
        pytest.skip("reads /proc")
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def test_many_members_leave_no_memory_behind(smooth) -> None:
    from render.datasets import to_grid

    field = np.random.default_rng(0).uniform(-1, 1, size=(96, 96, 96)).astype(np.float32)  # 3.4 MB
    camera = Camera.look_at((4, 3, 2), (0.5, 0.5, 0.5), vertical_fov_degrees=20, width=32, height=32)
    used = []
    for member in range(24):
        with Renderer(to_grid(field + member, spacing=1 / 95), VolumeRendering("dvr", smooth)) as volume:
            volume.render(camera)
        used.append(resident())
    assert used[-1] - used[7] < 12.0  # sixteen members of 3.4 MB, held twice or more, would be over 100


@pytest.mark.parametrize("float_output", [False, True])
def test_many_pictures_leave_no_memory_behind(smooth, float_output: bool) -> None:
    from render.datasets import to_grid

    camera = Camera.look_at((4, 3, 2), (0.5, 0.5, 0.5), vertical_fov_degrees=20, width=512, height=512)
    used = []
    with Renderer(to_grid(np.zeros((8, 8, 8)), spacing=1 / 7), VolumeRendering("dvr", smooth)) as volume:
        for _ in range(24):
            volume.render(camera, float_output=float_output)
            used.append(resident())
    assert used[-1] - used[7] < 12.0  # sixteen float pictures have 64
