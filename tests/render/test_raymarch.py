"""The reference against closed forms and other people's integrators: nothing here renders with VTK."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from render.datasets import to_grid
from render.grids import Grid
from tests.support.raymarch import box_intersections, converged, gradient, march, trilinear

SMOOTH = TransferFunction(((0, 0.1, 0.2, 0.9), (0.5, 0.8, 0.9, 0.1), (1, 1, 0.1, 0)), ((0, 0.0), (1, 0.8)), 0.3)


def one_pixel(position: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
    return Camera.look_at(position, target, vertical_fov_degrees=1e-3, width=1, height=1)


@pytest.mark.parametrize(("opacity", "unit"), [(0.3, 0.2), (0.99, 0.05), (1e-4, 1.0), (1.0, 0.5), (0.0, 1.0)])
@pytest.mark.parametrize("step", [0.01, 0.37, 5.0])
def test_a_homogeneous_medium_has_the_stated_opacity_at_any_step(opacity: float, unit: float, step: float) -> None:
    grid = to_grid(np.full((3, 3, 3), 0.5), spacing=(0.5, 0.75, 1.0))
    transfer = TransferFunction(((0, 1, 0.5, 0), (1, 1, 0.5, 0)), ((0, opacity), (1, opacity)), unit)
    camera = one_pixel((-5.0, 0.7, 0.9), (1.0, 0.7, 0.9))  # straight through the box's x extent of 1
    rgba = march(grid, VolumeRendering("flat", transfer), camera, step)[0, 0]
    alpha = 1.0 - (1.0 - opacity) ** (1.0 / unit)
    np.testing.assert_allclose(rgba, alpha * np.array([1.0, 0.5, 0.0, 1.0]), atol=1e-9)


@pytest.mark.slow
@settings(max_examples=6)
@given(seed=st.integers(0, 2**32 - 1))
def test_one_ray_solves_the_emission_absorption_equation(seed: int) -> None:
    random = np.random.default_rng(seed)
    grid = to_grid(random.random((5, 6, 7)), spacing=(0.2, 0.25, 0.3), origin=(1.0, -2.0, 0.5))
    camera = one_pixel(tuple(grid.center + 3 * random.normal(size=3) + [3, 0, 0]), tuple(grid.center))
    origin, directions = camera.rays()
    enter, leave = (float(d[0]) for d in box_intersections(grid, origin, directions.reshape(1, 3)))

    def slope(along: float, state: np.ndarray) -> np.ndarray:
        value = float(trilinear(grid, origin + along * directions[0, 0])[0])
        extinction = -math.log(1.0 - float(SMOOTH.opacities(value))) / SMOOTH.opacity_unit_distance
        return np.append(SMOOTH.colors(value) * extinction * state[3], -extinction * state[3])

    solved = solve_ivp(slope, (enter, leave), [0.0, 0.0, 0.0, 1.0], rtol=1e-10, atol=1e-11, max_step=0.02).y[:, -1]
    rgba = march(grid, VolumeRendering("smooth", SMOOTH), camera, 0.0002)[0, 0]
    np.testing.assert_allclose(rgba, np.append(solved[:3], 1.0 - solved[3]), atol=2e-6)


def test_halving_the_step_quarters_the_error() -> None:
    z, y, x = np.mgrid[0:1:17j, 0:1:17j, 0:1:17j]
    grid = to_grid(np.exp(-4 * ((x - 0.5) ** 2 + (y - 0.4) ** 2 + (z - 0.6) ** 2)), spacing=1 / 16)
    camera = Camera.look_at((3, 2, 2), grid.center, vertical_fov_degrees=25, width=24, height=24)
    appearance = VolumeRendering("smooth", SMOOTH)
    truth = march(grid, appearance, camera, 1 / 16 / 32)
    errors = [np.sqrt(np.mean((march(grid, appearance, camera, 1 / 16 * k) - truth) ** 2)) for k in (1, 0.5, 0.25)]
    assert 3.0 < errors[0] / errors[1] < 5.0
    assert 3.0 < errors[1] / errors[2] < 5.0
    image, change = converged(grid, appearance, camera)
    assert change <= 1e-5
    np.testing.assert_allclose(image, truth, atol=1e-4)


def test_trilinear_agrees_with_scipy_and_clamps_outside() -> None:
    random = np.random.default_rng(1)
    grid = to_grid(random.normal(size=(4, 5, 6)), spacing=(0.5, 1.0, 2.0), origin=(3.0, 4.0, 5.0))
    low, high = grid.bounds
    axes = [np.linspace(low[k], high[k], n) for k, n in ((2, 4), (1, 5), (0, 6))]
    scipys = RegularGridInterpolator(axes, grid.values.astype(np.float64))
    points = random.uniform(low - 1, high + 1, size=(500, 3))
    np.testing.assert_allclose(trilinear(grid, points)[0], scipys(np.clip(points, low, high)[:, ::-1]), atol=1e-12)


def test_the_gradient_of_a_linear_field_is_its_slope() -> None:
    z, y, x = np.mgrid[0:5, 0:6, 0:7]
    grid = to_grid(2.0 * (0.5 * x) - 3.0 * y + 0.25 * (2.0 * z), spacing=(0.5, 1.0, 2.0))
    points = np.random.default_rng(2).uniform((0.5, 1, 2), (2.5, 4, 6), size=(50, 3))
    np.testing.assert_allclose(gradient(grid, points), np.broadcast_to([2.0, -3.0, 0.25], (50, 3)), atol=1e-6)


@pytest.mark.parametrize("value", [0.7, -1e-30, 1e30])
def test_constant_regions_have_no_slope_though_interpolation_rounds(value: float) -> None:
    grid = to_grid(np.full((7, 6, 5), value), spacing=(0.3, 0.7, 1.1))
    points = np.random.default_rng(0).uniform(grid.bounds[0], grid.bounds[1], (1000, 3))
    values = trilinear(grid, points)[0]
    assert np.ptp(values) > 0  # so that the differences below are rounding, not zeros
    np.testing.assert_array_equal(gradient(grid, points), 0.0)


def test_a_slope_far_smaller_than_the_values_is_kept() -> None:
    x = np.arange(5.0)
    grid = to_grid(1e6 + np.broadcast_to(1e-3 * x, (5, 5, 5)))
    np.testing.assert_allclose(gradient(grid, np.full((1, 3), 2.0)), [[1e-3, 0.0, 0.0]], rtol=1e-6, atol=0.0)


def test_cells_at_holes_are_hidden_and_no_others() -> None:
    values = np.ones((4, 4, 4))
    values[1, 2, 3] = np.nan
    grid = to_grid(values, nan="transparent")
    points = np.random.default_rng(3).uniform(0, 3, size=(2000, 3))
    cells = np.floor(points).astype(int)  # x, y, z
    expected = (cells[:, 0] == 2) & np.isin(cells[:, 1], (1, 2)) & np.isin(cells[:, 2], (0, 1))
    np.testing.assert_array_equal(trilinear(grid, points)[1], expected)


def test_rays_beside_and_inside_the_box() -> None:
    grid = Grid(np.zeros((2, 2, 2), dtype=np.float32))
    straight = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    enter, leave = box_intersections(grid, np.array([-2.0, 0.5, 0.5]), straight)
    np.testing.assert_allclose([enter[0], leave[0]], [2.0, 3.0])
    assert leave[1] < enter[1]
    enter, leave = box_intersections(grid, np.array([0.25, 0.5, 0.5]), straight)
    np.testing.assert_allclose(enter, 0.0)
    np.testing.assert_allclose(leave, [0.75, 0.25])
    enter, leave = box_intersections(grid, np.array([-2.0, 1.5, 0.5]), straight)
    assert (leave < enter).all()


def test_a_transfer_function_too_steep_for_the_grid_is_refused() -> None:
    spikes = TransferFunction(((0, 1, 1, 1), (1, 1, 1, 1)), ((0, 0), (0.5, 0), (0.501, 1), (0.502, 0), (1, 0)), 1e-4)
    z, y, x = np.mgrid[0:1:5j, 0:1:5j, 0:1:5j]
    camera = Camera.look_at((3, 2, 2), (0.5, 0.5, 0.5), vertical_fov_degrees=25, width=8, height=8)
    with pytest.raises(RuntimeError, match="too steep"):
        converged(to_grid(x + 0 * y * z, spacing=0.25), VolumeRendering("spikes", spikes), camera)
