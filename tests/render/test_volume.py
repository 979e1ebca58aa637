"""Volume pictures, VTK's and the ray caster's, against the float64 ray-marcher and the pinhole camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from render import render_views
from render.datasets import to_grid
from render.grids import Grid
from render.quality import psnr
from render.views import Renderer
from render.window import open_window
from tests.support.raymarch import march

Draw = Callable[[Grid, VolumeRendering, Camera, float], np.ndarray]
GRAY = ((0.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0))


def around(grid: Grid, count: int = 3, size: int = 64) -> list[Camera]:
    return orbit(grid.center, grid.bounding_radius, width=size, height=size, frequency=2)[5 :: 42 // count][:count]


@pytest.fixture(params=["vtk", "cpu"])
def drawn(request) -> Draw:
    def draw(grid: Grid, appearance: VolumeRendering, camera: Camera, distance: float) -> np.ndarray:
        views = render_views(
            grid, appearance, [camera], sample_distance=distance, float_output=True, backend=request.param
        )
        return next(views)

    return draw


@pytest.mark.parametrize("shaded", [False, True])
@pytest.mark.parametrize("profile", ["smooth", "peaks"])
def test_pictures_equal_the_ray_marchers_at_the_same_steps(drawn: Draw, gyroid, profile, shaded, request) -> None:
    appearance = VolumeRendering("dvr", request.getfixturevalue(profile), shaded)
    distance = min(gyroid.spacing) / 2
    for camera in around(gyroid):
        expected = march(gyroid, appearance, camera, distance)
        assert expected[..., 3].max() > 0.5
        error = np.abs(drawn(gyroid, appearance, camera, distance) - expected)
        assert np.percentile(error, 99) < 2e-3  # rays at edges may take one step more or less
        assert error.mean() < 1e-4


def test_pictures_converge_to_the_ray_marchers(drawn: Draw, gyroid, smooth) -> None:
    appearance = VolumeRendering("dvr", smooth)
    camera = around(gyroid)[1]
    truth = march(gyroid, appearance, camera, min(gyroid.spacing) / 32)
    decibels = [psnr(drawn(gyroid, appearance, camera, min(gyroid.spacing) * k), truth) for k in (1, 0.5, 0.25)]
    assert decibels[0] > 50
    assert decibels[1] > decibels[0] + 6
    assert decibels[2] > 70


@pytest.mark.parametrize("value", [-5.0, 0.0, 0.25, 0.5, 1.0, 1e30])
def test_a_constant_field_is_a_homogeneous_medium(drawn: Draw, value: float) -> None:
    grid = to_grid(np.full((4, 4, 4), value), spacing=1 / 3)
    transfer = TransferFunction(((0, 1, 0, 0), (1, 0, 0, 1)), ((0, 0.0), (1, 0.6)), 0.5)
    camera = Camera.look_at((-4, 0.5, 0.5), (0.5, 0.5, 0.5), vertical_fov_degrees=1e-2, width=8, height=8)
    rgba = drawn(grid, VolumeRendering("flat", transfer), camera, 0.21)[4, 4]
    clipped = min(max(value, 0.0), 1.0)
    alpha = 1 - (1 - 0.6 * clipped) ** (1 / 0.5)
    np.testing.assert_allclose(rgba, alpha * np.array([1 - clipped, 0, clipped, 1]), atol=1e-4)


@pytest.mark.parametrize("value", [0.1, 0.3, 0.7, 0.9])
def test_a_constant_region_has_ambient_light_only(drawn: Draw, value: float) -> None:
    values = np.full((9, 10, 11), value)
    values[:, :, 0] = 0.0  # the range drawn is not empty; seen from far beyond the other end
    values[:, :, 1] = 1.0
    grid = to_grid(values, spacing=(0.13, 0.11, 0.17))
    transfer = TransferFunction(((0, 1, 0.5, 0), (1, 1, 0.5, 0)), ((0, 1.0), (1, 1.0)), 1e-3)
    camera = Camera.look_at((9, 0.31, 0.47), (0.6, 0.53, 0.61), vertical_fov_degrees=3.0, width=16, height=16)
    rgba = drawn(grid, VolumeRendering("flat", transfer, shaded=True), camera, 0.05)
    np.testing.assert_allclose(rgba, np.broadcast_to([0.1, 0.05, 0, 1], rgba.shape), atol=1e-5)


def test_opacity_does_not_depend_on_the_step(drawn: Draw, gyroid) -> None:
    transfer = TransferFunction(GRAY, ((0.0, 0.5), (1.0, 0.5)), 0.7)
    flat = to_grid(np.full(gyroid.shape, 0.5), spacing=(0.02, 0.4, 0.4))  # thin: 20 : 1
    for camera in around(flat):
        pictures = [drawn(flat, VolumeRendering("flat", transfer), camera, step) for step in (3.0, 0.4, 0.013)]
        np.testing.assert_allclose(pictures[0], pictures[2], atol=1e-3)
        np.testing.assert_allclose(pictures[1], pictures[2], atol=1e-3)


def test_values_far_beyond_the_transfer_function_do_not_blur_it(drawn: Draw, smooth) -> None:
    field = np.random.default_rng(0).uniform(-1, 1, size=(8, 8, 8))
    field[0, 0, 0], field[7, 7, 7] = 3e38, -3e38
    grid = to_grid(field)
    appearance = VolumeRendering("dvr", smooth)
    for camera in around(grid):
        expected = march(grid, appearance, camera, 0.125)
        assert psnr(drawn(grid, appearance, camera, 0.125), expected) > 45


def moved(transfer: TransferFunction, scale: float, offset: float) -> TransferFunction:
    """The transfer function of `scale * value + offset`."""
    colors = tuple((scale * v + offset, *rgb) for v, *rgb in transfer.color_points)
    opacities = tuple((scale * v + offset, o) for v, o in transfer.opacity_points)
    return TransferFunction(colors, opacities, transfer.opacity_unit_distance)


@pytest.mark.parametrize("shaded", [False, True])
@pytest.mark.parametrize(
    ("scale", "offset", "dtype"),
    [
        (1.0, 1e9, "f8"),
        (1.0, -1e12, ">f8"),
        (1e30, 0.0, "f4"),
        (1e-30, 0.0, "f4"),
        (1e40, 1e40, "f8"),
        (1e300, 0.0, "f8"),
        (1e-300, 0.0, "f8"),
        (1e7, 1e9, "i4"),
        (1e9, 2.0**60, ">i8"),
        (1e9, 2.0**63, "u8"),
        (1e3, 0.0, "f2"),
    ],
)
def test_pictures_do_not_depend_on_the_unit_of_the_field_nor_on_its_zero(
    drawn: Draw, gyroid, smooth, scale, offset, dtype, shaded
) -> None:
    kind = np.dtype(dtype)
    values = (scale * gyroid.values.astype(np.float64)).astype(kind if kind.kind == "f" else np.int64)
    grid = to_grid((values.astype(kind) + kind.type(offset)).astype(kind), spacing=gyroid.spacing, origin=gyroid.origin)
    camera = around(gyroid)[0]
    here = drawn(gyroid, VolumeRendering("dvr", smooth, shaded), camera, 0.05)
    there = drawn(grid, VolumeRendering("dvr", moved(smooth, scale, offset), shaded), camera, 0.05)
    assert psnr(there, here) > 55


@pytest.mark.parametrize("outlier", [1e9, 1e40, 1e300])
def test_a_value_far_out_of_range_neither_overflows_nor_moves_its_neighbours(
    drawn: Draw, gyroid, smooth, outlier: float
) -> None:
    field = gyroid.values.astype(np.float64)
    field[10, 10, 10], field[20, 14, 12] = outlier, -outlier
    grid = to_grid(field, spacing=gyroid.spacing, origin=gyroid.origin)
    for camera in around(grid):
        expected = march(grid, VolumeRendering("dvr", smooth), camera, 0.02)
        assert psnr(drawn(grid, VolumeRendering("dvr", smooth), camera, 0.02), expected) > 60


def test_light_follows_a_field_that_spans_little_of_its_transfer_function(drawn: Draw, gyroid, smooth) -> None:
    grid = to_grid(1e-6 * gyroid.values.astype(np.float64) + 0.5, spacing=gyroid.spacing, origin=gyroid.origin)
    appearance = VolumeRendering("dvr", smooth, shaded=True)
    for camera in around(grid):
        assert psnr(drawn(grid, appearance, camera, 0.02), march(grid, appearance, camera, 0.02)) > 60


@pytest.mark.parametrize("profile", ["smooth", "peaks"])
def test_holes_are_transparent_and_colour_nothing_around_them(drawn: Draw, gyroid, profile, request) -> None:
    field = gyroid.values.astype(np.float64)
    field[5:26, 8:20, 6:14] = np.nan
    field[20, 20, 20] = np.inf
    field[0, 0, :] = np.nan
    grid = to_grid(field, spacing=gyroid.spacing, origin=gyroid.origin, nan="transparent")
    appearance = VolumeRendering("dvr", request.getfixturevalue(profile))
    distance = min(grid.spacing) / 8
    for camera in around(grid):
        picture = drawn(grid, appearance, camera, distance)
        assert psnr(picture, march(grid, appearance, camera, distance)) > 55
        assert psnr(picture, march(gyroid, appearance, camera, distance)) < 45  # the holes do show


@pytest.mark.parametrize("backend", ["vtk", "cpu"])
def test_eight_bits_are_the_rounded_floats_and_premultiplied(gyroid, smooth, backend) -> None:
    appearance = VolumeRendering("dvr", smooth)
    cameras = around(gyroid)
    floats = list(render_views(gyroid, appearance, cameras, float_output=True, backend=backend))
    for exact, image in zip(floats, render_views(gyroid, appearance, cameras, backend=backend), strict=True):
        assert image.dtype == np.uint8
        assert exact.dtype == np.float32
        assert np.abs(exact * 255 - image).max() < 0.51
        assert (image[..., :3] <= image[..., 3:]).all()
        assert image[0, 0].max() == 0


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e22])
def test_pictures_do_not_depend_on_where_and_how_large_the_world_is(drawn: Draw, gyroid, smooth, scale: float) -> None:
    here = drawn(gyroid, VolumeRendering("dvr", smooth), around(gyroid)[0], 0.05)
    transfer = TransferFunction(smooth.color_points, smooth.opacity_points, smooth.opacity_unit_distance * scale)
    grid, camera = enlarged(gyroid, around(gyroid)[0], scale, (5e6, -3e6, 1e6))
    np.testing.assert_allclose(drawn(grid, VolumeRendering("dvr", transfer), camera, 0.05 * scale), here, atol=2e-3)


def enlarged(
    grid: Grid, camera: Camera, scale: float, offset: Sequence[float] = (0.0, 0.0, 0.0)
) -> tuple[Grid, Camera]:
    """The world moved by `offset`, then scaled."""
    matrix = camera.world_to_camera.copy()
    matrix[:3, 3] = scale * (matrix[:3, 3] - camera.rotation @ offset)
    moved = Camera(matrix, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    return Grid(
        grid.values, tuple(scale * np.array(grid.spacing)), tuple(scale * (grid.origin + np.array(offset)))
    ), moved


@pytest.mark.parametrize("shaded", [False, True])
@pytest.mark.parametrize(
    ("exponent", "share"),
    [(-9, 1), (1, 0), (1.7, 0), (3, 0), (6, 0), (9, 0), (9, 0.3), (9, 1)],
)
def test_a_unit_of_length_changes_no_picture(drawn: Draw, gyroid, smooth, exponent, share, shaded) -> None:
    """The world in another unit, with the unit distance of opacity as it is, or in that unit, or between; opacities match."""
    scale = 10.0**exponent
    kept = scale**share  # the factor of the unit distance
    values = np.unique([*np.linspace(-1, 1, 60), *(v for v, _ in smooth.opacity_points)])
    fine = -np.expm1(np.log1p(-smooth.opacities(values)) * kept / scale)
    camera = around(gyroid, size=24)[0]
    table = tuple(zip(values, smooth.opacities(values), strict=True))
    here = TransferFunction(smooth.color_points, table, smooth.opacity_unit_distance)
    there = TransferFunction(
        smooth.color_points, tuple(zip(values, fine, strict=True)), kept * smooth.opacity_unit_distance
    )
    grid, moved = enlarged(gyroid, camera, scale)
    expected = drawn(gyroid, VolumeRendering("dvr", here, shaded), camera, 0.05)
    picture = drawn(grid, VolumeRendering("dvr", there, shaded), moved, 0.05 * scale)
    assert expected[..., 3].max() > 0.5
    np.testing.assert_allclose(
        picture, expected, atol=2e-4 if share == 1 else 4e-3
    )  # straight between points or nearly


@pytest.mark.parametrize("opacity", [1e-3, 1e-6, 1e-7, 1e-12])
def test_a_deep_thin_medium_has_its_opacity(drawn: Draw, opacity: float) -> None:
    side = 0.7 / opacity  # unit distances
    grid = to_grid(np.full((4, 4, 4), 0.5), spacing=side / 3)
    transfer = TransferFunction(GRAY, ((0.0, opacity), (1.0, opacity)), 1.0)
    middle = np.full(3, side / 2)
    camera = Camera.look_at(middle - [8 * side, 0, 0], middle, vertical_fov_degrees=1e-2, width=8, height=8)
    for distance in (side / 100, side / 3, side):
        rgba = drawn(grid, VolumeRendering("thin", transfer), camera, distance)[4, 4]
        np.testing.assert_allclose(rgba, -math.expm1(side * math.log1p(-opacity)), rtol=1e-4)


def test_any_pinhole_camera_off_centre_oblong_from_inside_and_facing_away(drawn: Draw, gyroid, smooth) -> None:
    appearance = VolumeRendering("dvr", smooth)
    base = around(gyroid)[0]
    off_centre = Camera(base.world_to_camera, 150.0, 110.0, 20.0, 41.5, 80, 48)
    ahead = gyroid.center + np.array([1.0, 1.0, 0.5])
    inside = Camera.look_at(gyroid.center, ahead, vertical_fov_degrees=70, width=40, height=56)
    for camera in (off_centre, inside):
        expected = march(gyroid, appearance, camera, 0.01)
        assert expected[..., 3].max() > 0.5
        assert psnr(drawn(gyroid, appearance, camera, 0.01), expected) > 55
    away = Camera.look_at(base.position, 2 * base.position - gyroid.center, vertical_fov_degrees=30, width=8, height=8)
    assert not drawn(gyroid, appearance, away, 0.04).any()


@pytest.mark.parametrize("distance", [0.0, -1.0, math.nan, math.inf])
def test_a_sample_distance_is_a_positive_length(gyroid, smooth, distance: float) -> None:
    with pytest.raises(ValueError, match="sample_distance must be a positive length"):
        Renderer(gyroid, VolumeRendering("dvr", smooth), sample_distance=distance)


def test_a_grid_longer_than_opengl_takes_is_refused_not_drawn_empty(smooth) -> None:
    grid = to_grid(np.zeros((2, 2, open_window().longest_volume + 1), dtype=np.float32))
    with pytest.raises(ValueError, match="samples along one axis, but this machine's OpenGL takes"):
        Renderer(grid, VolumeRendering("dvr", smooth))


def test_open_renderers_take_turns_and_a_closed_one_says_so(gyroid, smooth, peaks) -> None:
    camera = around(gyroid)[0]
    with Renderer(gyroid, VolumeRendering("a", smooth)) as first:
        alone = first.render(camera)
        with Renderer(gyroid, VolumeRendering("b", peaks)) as second:
            other = second.render(camera.resized(32, 48))
            np.testing.assert_array_equal(first.render(camera), alone)
            np.testing.assert_array_equal(second.render(camera.resized(32, 48)), other)
            assert other.shape == (48, 32, 4)
    with pytest.raises(RuntimeError, match="closed"):
        first.render(camera)
