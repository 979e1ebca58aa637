"""Pictures put together from blocks, against the picture of the whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from render.datasets import to_grid
from render.grids import Grid
from render.layers import BlockRenderer
from render.partition import Piece
from render.quality import psnr
from render.views import render_views
from tests.support.decomposed import blocks_of, composited, kd_boxes, pinwheel
from tests.support.raymarch import march

FLOAT, EIGHT_BITS, SURFACES = 90.0, 80.0, 60.0  # dB


def one(grid: Grid) -> list[Piece]:
    return [Piece(0, (0, 0, 0), grid.shape)]


def worst(grid: Grid, owned, appearance, cameras, *, float_output: bool = True, distance=0.05) -> float:
    """Of all views the smallest PSNR, dB, of the picture composited from blocks against the one of a single block."""
    asked = {"sample_distance": distance, "float_output": float_output}
    whole, parts = (composited(grid, boxes, appearance, cameras, **asked) for boxes in (one(grid), owned))
    scale = 1.0 if float_output else 255.0
    return min(psnr(a / scale, b / scale) for a, b in zip(parts, whole, strict=True))


def views(grid: Grid, count: int = 6, size: int = 72) -> list[Camera]:
    return list(orbit(grid.center, grid.bounding_radius, width=size, height=size, frequency=5))[:: 252 // count][:count]


@pytest.mark.parametrize("shaded", [False, True])
def test_a_single_block_is_drawn_as_without_blocks(gyroid, smooth, shaded) -> None:
    appearance, cameras = VolumeRendering("dvr", smooth, shaded=shaded), views(gyroid)
    for float_output, least in ((True, FLOAT), (False, EIGHT_BITS)):
        asked = {"sample_distance": 0.05, "float_output": float_output}
        alone = render_views(gyroid, appearance, cameras, **asked, backend="vtk")
        scale = 1.0 if float_output else 255.0
        for image, other in zip(composited(gyroid, one(gyroid), appearance, cameras, **asked), alone, strict=True):
            assert psnr(image / scale, other / scale) >= least


@pytest.mark.parametrize("where", ["outside", "inside", "at a face"])
def test_blocks_against_the_ray_marcher(gyroid, smooth, where) -> None:
    center, size = gyroid.center, {"vertical_fov_degrees": 70, "width": 40, "height": 40}
    low, _ = gyroid.bounds
    camera = {
        "outside": views(gyroid, 3, 40)[1],
        "inside": Camera.look_at(center + np.array([-0.9, 0.4, 0.6]), center, **size),
        "at a face": Camera.look_at([low[0], center[1], center[2]], center, **size),
    }[where]
    appearance = VolumeRendering("dvr", smooth)
    owned = kd_boxes(gyroid.shape, 5, np.random.default_rng(4))
    (image,) = composited(gyroid, owned, appearance, [camera], sample_distance=0.02)
    assert psnr(image, march(gyroid, appearance, camera, 0.02)) >= 95.0


@pytest.mark.parametrize("shaded", [False, True])
@pytest.mark.parametrize("count", [pytest.param(2, marks=pytest.mark.slow), 5, pytest.param(8, marks=pytest.mark.slow)])
def test_uneven_blocks_of_a_volume(gyroid, peaks, smooth, shaded, count) -> None:
    owned = kd_boxes(gyroid.shape, count, np.random.default_rng(count))
    for transfer in (smooth, peaks):
        appearance = VolumeRendering("dvr", transfer, shaded=shaded)
        assert worst(gyroid, owned, appearance, views(gyroid), float_output=True) >= FLOAT
    assert (
        worst(gyroid, owned, VolumeRendering("dvr", peaks, shaded=shaded), views(gyroid), float_output=False)
        >= EIGHT_BITS
    )


@pytest.mark.parametrize("count", [1, 3, 8])
def test_uneven_blocks_of_an_isosurface(gyroid, count) -> None:
    owned = kd_boxes(gyroid.shape, count, np.random.default_rng(count))
    for float_output in (True, False):
        assert worst(gyroid, owned, Isosurface("iso", 0.2), views(gyroid), float_output=float_output) >= SURFACES


def test_blocks_that_hide_one_another_in_a_circle(smooth) -> None:
    z, y, x = np.mgrid[0:24, 0:24, 0:24] / 12.0 - 1.0
    grid = to_grid(np.sin(4 * x) * np.cos(3 * y) + 0.5 * np.sin(5 * z), spacing=2 / 23, origin=(-1, -1, -1))
    appearance = VolumeRendering("dvr", smooth, shaded=True)
    assert worst(grid, pinwheel(24), appearance, views(grid, 12), float_output=True) >= FLOAT


SLABS = [(0, 1), (1, 2), (2, 3), (3, 31), (31, 32)]  # samples along z


@pytest.mark.parametrize("appearance", ["plain", "shaded", "surface"])
def test_blocks_of_a_single_layer_even_at_the_ends(gyroid, smooth, appearance) -> None:
    owned = [Piece(n, (a, 0, 0), (b, 28, 24)) for n, (a, b) in enumerate(SLABS)]
    shown = {
        "plain": VolumeRendering("dvr", smooth),
        "shaded": VolumeRendering("dvr", smooth, shaded=True),
        "surface": Isosurface("iso", 0.2),
    }[appearance]
    least = SURFACES if appearance == "surface" else FLOAT
    assert worst(gyroid, owned, shown, views(gyroid), float_output=True) >= least


@pytest.mark.parametrize("shaded", [False, True])
def test_holes_that_reach_over_blocks(gyroid, smooth, shaded) -> None:
    values = np.array(gyroid.values, dtype=np.float64)
    z, y, x = np.indices(values.shape)
    values[(z - 15) ** 2 + (y - 14) ** 2 + (x - 12) ** 2 < 40] = np.nan
    grid = to_grid(values, spacing=gyroid.spacing, origin=gyroid.origin, nan="transparent")
    owned = kd_boxes(grid.shape, 6, np.random.default_rng(7))
    assert worst(grid, owned, VolumeRendering("dvr", smooth, shaded=shaded), views(grid), float_output=True) >= FLOAT
    assert worst(grid, owned, Isosurface("iso", 0.2), views(grid), float_output=True) >= SURFACES


def test_an_eye_within_the_box(gyroid, smooth) -> None:
    center = gyroid.center
    cameras = [
        Camera.look_at(
            center + offset, center + np.array([0.3, 1.0, 0.4]), width=60, height=60, vertical_fov_degrees=70
        )
        for offset in ([0.01, -0.02, 0.03], [-0.9, 0.4, 0.6])
    ]
    owned = kd_boxes(gyroid.shape, 7, np.random.default_rng(2))
    assert worst(gyroid, owned, VolumeRendering("dvr", smooth, shaded=True), cameras, float_output=True) >= FLOAT


def test_a_volume_that_is_opaque_at_once(gyroid, smooth) -> None:
    opaque = replace(smooth, opacity_points=((-1.0, 1.0), (1.0, 1.0)))
    owned = kd_boxes(gyroid.shape, 6, np.random.default_rng(5))
    assert worst(gyroid, owned, VolumeRendering("dvr", opaque), views(gyroid), float_output=True) >= 70.0


def test_far_from_the_origin_and_in_centimetres(gyroid, smooth) -> None:
    far = Grid(gyroid.values, tuple(1e22 * s for s in gyroid.spacing), (3e22, -4e23, 1e23))
    owned = kd_boxes(far.shape, 4, np.random.default_rng(1))
    assert worst(far, owned, VolumeRendering("dvr", smooth), views(far), float_output=True, distance=5e20) >= FLOAT


def test_nothing_is_drawn_of_what_lies_in_no_row(gyroid, smooth) -> None:
    (block,) = blocks_of(gyroid, [Piece(0, (0, 0, 0), gyroid.shape)])
    camera = views(gyroid, 1)[0]
    with BlockRenderer(block, VolumeRendering("dvr", smooth)) as renderer:
        assert renderer.layer(camera, block.owned, slice(3, 3), slice(0, 9)).image.shape == (0, 9, 4)
    with BlockRenderer(block, Isosurface("iso", 99.0)) as renderer:
        empty = renderer.layer(camera, block.owned, slice(0, 8), slice(0, 9))
        assert not empty.image.any()
        assert (empty.depths == 1.0).all()


@pytest.mark.slow
def test_views_from_everywhere_of_eight_blocks(gyroid, peaks) -> None:
    owned = kd_boxes(gyroid.shape, 8, np.random.default_rng(8))
    cameras = views(gyroid, 84, 64)
    shaded = VolumeRendering("dvr", peaks, shaded=True)
    whole, parts = (composited(gyroid, boxes, shaded, cameras, sample_distance=0.05) for boxes in (one(gyroid), owned))
    for image, other in zip(parts, whole, strict=True):
        assert psnr(image, other) >= FLOAT
        assert psnr(np.rint(255 * image) / 255, np.rint(255 * other) / 255) >= EIGHT_BITS
