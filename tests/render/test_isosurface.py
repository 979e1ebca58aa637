"""Isosurfaces against rays that find the surface by themselves, and the cases where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import Camera, orbit
from render import render_views
from render.datasets import to_grid
from render.grids import Grid
from render.isosurface import box_average, extract
from render.placement import Placement
from render.quality import psnr
from render.views import Renderer
from tests.support.raymarch import box_intersections, gradient, trilinear

SURFACE = Isosurface("iso", 0.6, (0.9, 0.5, 0.2))


def triangles(grid: Grid, isovalue: float) -> int:
    return extract(grid, isovalue, Placement.of(grid)).GetNumberOfPolys()


def ball(samples: int = 49, radius_value: float = 0.0) -> Grid:
    """Distance from the centre of a unit box, (z, y, x), spacings 1 : 1 : 1."""
    z, y, x = np.mgrid[-1 : 1 : samples * 1j, -1 : 1 : samples * 1j, -1 : 1 : samples * 1j]
    return to_grid(np.sqrt(x**2 + y**2 + z**2) + radius_value, spacing=2 / (samples - 1), origin=(-1, -1, -1))


def traced(grid: Grid, surface: Isosurface, camera: Camera) -> np.ndarray:
    """The picture [H, W, 4] found ray by ray: first root of the trilinear field, 4 x 4 rays per pixel, float64."""
    finer = camera.resized(4 * camera.width, 4 * camera.height)
    origin, directions = finer.rays()
    flat = directions.reshape(-1, 3)
    enter, leave = box_intersections(grid, origin, flat)
    image = np.zeros((len(flat), 4))
    for ray in np.flatnonzero(leave > enter):
        along = np.linspace(enter[ray], leave[ray], 120)
        above = trilinear(grid, origin + along[:, None] * flat[ray])[0] > surface.isovalue
        changes = np.flatnonzero(above[1:] != above[:-1])
        if not len(changes):
            continue

        def level(distance: float, ray: int = ray) -> float:
            return float(trilinear(grid, origin + distance * flat[ray])[0]) - surface.isovalue

        point = origin + brentq(level, along[changes[0]], along[changes[0] + 1]) * flat[ray]
        slope = gradient(grid, point)
        facing = abs(slope @ flat[ray]) / np.linalg.norm(slope)
        shade = (surface.ambient + surface.diffuse * facing) * np.array(surface.color)
        image[ray] = np.append(np.clip(shade + surface.specular * facing**surface.specular_power, 0, 1), 1.0)
    return image.reshape(camera.height, 4, camera.width, 4, 4).mean(axis=(1, 3))


def views(grid: Grid, size: int = 32) -> list[Camera]:
    return orbit(grid.center, grid.bounding_radius, width=size, height=size, frequency=1)[2::5]


@pytest.mark.slow
@pytest.mark.parametrize("field", ["ball", "gyroid"])
def test_pictures_equal_what_rays_find(field: str, gyroid: Grid) -> None:
    grid, surface = (ball(), SURFACE) if field == "ball" else (gyroid, Isosurface("iso", 0.1, (0.2, 0.7, 0.9)))
    for camera in views(grid)[:2]:
        expected = traced(grid, surface, camera)
        picture = next(render_views(grid, surface, [camera], float_output=True))
        inside = expected[..., 3] == 1
        assert inside.mean() > 0.05
        assert np.median(np.abs(picture - expected)[inside]) < 0.01
        assert np.abs(picture[..., 3] - expected[..., 3]).mean() < 0.01  # silhouettes: 4 against 16 samples a pixel


def test_shading_of_a_ball_is_the_formula_in_the_middle_of_the_picture() -> None:
    camera = Camera.look_at((6, 0, 0), (0, 0, 0), vertical_fov_degrees=20, width=33, height=33)
    rgba = next(render_views(ball(), SURFACE, [camera], float_output=True))[16, 16]
    expected = 0.9 * np.array(SURFACE.color) + 0.2
    np.testing.assert_allclose(rgba, np.append(np.minimum(expected, 1), 1), atol=0.01)


def test_both_sides_are_lit() -> None:
    inside = Camera.look_at((0, 0, 0), (0, 1, 0), vertical_fov_degrees=40, width=16, height=16)
    image = next(render_views(ball(), SURFACE, [inside]))
    assert (image[..., 3] == 255).all()
    assert image[8, 8, 0] > 200


@pytest.mark.parametrize("isovalue", [-1.0, 99.0])
def test_an_empty_isosurface_is_an_empty_picture(isovalue: float) -> None:
    grid = ball(9)
    with Renderer(grid, Isosurface("none", isovalue)) as surface:
        assert triangles(grid, isovalue) == 0
        for camera in views(grid):
            assert not surface.render(camera).any()
            assert surface.render(camera, float_output=True).shape == (32, 32, 4)


@pytest.mark.parametrize("isovalue", [3.0, 4.0])
def test_a_constant_field_has_no_surface(isovalue: float) -> None:
    grid = to_grid(np.full((2, 2, 2), 3.0))
    assert not next(render_views(grid, Isosurface("flat", isovalue), views(grid)[:1])).any()


def test_the_smallest_grid_has_a_surface() -> None:
    grid = to_grid(np.arange(8.0).reshape(2, 2, 2))
    assert next(render_views(grid, Isosurface("plane", 3.5), views(grid)[:1])).any()


@pytest.mark.parametrize("level", [0.0, 0.4])
@pytest.mark.parametrize(
    ("scale", "dtype"),
    [
        (1e-300, "f8"),
        (1e-37, "f4"),
        (1e-20, "f4"),
        (1e-9, "f8"),
        (1e15, "f4"),
        (3e20, "f4"),
        (3e20, "f8"),
        (1e37, "f4"),
        (1e300, "f8"),
    ],
)
def test_light_does_not_depend_on_the_unit_of_the_field(scale: float, level: float, dtype: str) -> None:
    whole = ball(17, -0.5)
    camera = views(whole, 16)[0]
    grid = to_grid((scale * whole.values.astype(np.float64)).astype(dtype), spacing=whole.spacing, origin=whole.origin)
    expected = next(render_views(whole, Isosurface("iso", level), [camera], float_output=True))
    picture = next(render_views(grid, Isosurface("iso", level * scale), [camera], float_output=True))
    assert expected[..., 0].max() > 0.5
    np.testing.assert_allclose(picture, expected, atol=1e-3)


@pytest.mark.parametrize(
    ("offset", "scale", "outlier"),
    [(1e9, 1.0, 0.0), (-1e12, 1.0, 0.0), (1e40, 1e30, 0.0), (0.0, 1.0, 1e300), (0.0, 1e-30, 1.0)],
)
def test_a_surface_lies_where_it_does_beside_any_offset_and_outlier(offset, scale, outlier) -> None:
    whole = ball(17)
    field = scale * whole.values.astype(np.float64) + offset
    field[0, 0, 0] += outlier
    grid = to_grid(field, spacing=whole.spacing, origin=whole.origin)
    camera = views(whole, 16)[0]
    expected = next(render_views(whole, SURFACE, [camera], float_output=True))
    picture = next(
        render_views(grid, Isosurface("iso", 0.6 * scale + offset, SURFACE.color), [camera], float_output=True)
    )
    np.testing.assert_allclose(picture, expected, atol=2e-3)


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_a_unit_of_length_changes_no_picture(scale: float) -> None:
    whole = ball(17)
    camera = views(whole, 16)[0]
    matrix = camera.world_to_camera.copy()
    matrix[:3, 3] *= scale
    moved = Camera(matrix, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    grid = Grid(whole.values, tuple(scale * np.array(whole.spacing)), tuple(scale * np.array(whole.origin)))
    expected = next(render_views(whole, SURFACE, [camera], float_output=True))
    np.testing.assert_allclose(next(render_views(grid, SURFACE, [moved], float_output=True)), expected, atol=1e-3)


def test_cells_at_holes_have_no_surface() -> None:
    whole = ball(33)
    field = whole.values.astype(np.float64)
    field[:, :, :16] = np.nan
    half = to_grid(field, spacing=whole.spacing, origin=whole.origin, nan="transparent")
    assert 0.35 < triangles(half, SURFACE.isovalue) / triangles(whole, SURFACE.isovalue) < 0.55
    with Renderer(whole, SURFACE) as full, Renderer(half, SURFACE) as rest:
        camera = Camera.look_at((0, -8, 0), (0, 0, 0), vertical_fov_degrees=20, width=64, height=64)  # +x to the right
        np.testing.assert_array_equal(rest.render(camera)[:, 34:], full.render(camera)[:, 34:])
        assert not rest.render(camera)[:, :31].any()


def test_eight_bits_are_the_rounded_floats() -> None:
    grid = ball(17)
    for camera in views(grid):
        exact = next(render_views(grid, SURFACE, [camera], float_output=True))
        image = next(render_views(grid, SURFACE, [camera]))
        assert np.abs(exact * 255 - image).max() < 1.01  # rounded once per sample and once for the mean


@pytest.mark.parametrize("n", [1, 2, 4, 16])
def test_box_average_is_the_mean_rounded_to_nearest(n: int) -> None:
    random = np.random.default_rng(0)
    image = random.integers(0, 256, size=(3 * n, 4 * n, 4)).astype(np.uint8)
    image[:n, :n] = 255  # the largest sum there is
    expected = image.reshape(3, n, 4, n, 4).astype(float).mean(axis=(1, 3))
    np.testing.assert_array_equal(box_average(image, n), np.floor(expected + 0.5))
    np.testing.assert_allclose(box_average(image.astype(np.float32), n), expected, rtol=1e-6)


def test_edges_are_nearly_as_smooth_as_many_more_samples_make_them() -> None:
    grid = ball(33)

    def drawn(camera: Camera, samples: int | None = None) -> np.ndarray:
        with Renderer(grid, SURFACE, samples=samples) as surface:
            return surface.render(camera, float_output=True)

    for camera in views(grid):
        exact = drawn(camera, 16)
        assert psnr(drawn(camera), exact) > 45.0
        assert psnr(drawn(camera, 2), exact) < 42.0


def test_a_closed_renderer_says_so() -> None:
    grid = ball(9)
    with Renderer(grid, SURFACE) as surface:
        pass
    with pytest.raises(RuntimeError, match="closed"):
        surface.render(views(grid)[0])
