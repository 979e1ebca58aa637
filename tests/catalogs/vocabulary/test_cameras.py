"""One pinhole model, and the 252 viewpoints in the order that every catalog relies on."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.vocabulary.cameras import Camera, icosphere, orbit, spherical_angles, view_splits

numbers = st.floats(-50.0, 50.0)
points = st.tuples(numbers, numbers, numbers)


CHECKSUM = (0.315558585, -1.366383415, -0.278611828)  # depends on every viewpoint and on their order


def test_the_viewpoints_and_their_order_are_fixed_forever() -> None:
    directions = icosphere(5)
    assert directions.shape == (252, 3)
    expected = {
        0: (0.0, -0.52573111212, 0.85065080835),
        1: (-0.11589512563, -0.65110275494, 0.75008900963),
        2: (0.11589512563, -0.65110275494, 0.75008900963),
        251: (0.0, 0.52573111212, -0.85065080835),
    }
    for index, direction in expected.items():
        assert directions[index] == pytest.approx(direction, abs=1e-8), index
    assert np.sum(directions * np.sin(np.arange(252))[:, None], axis=0) == pytest.approx(CHECKSUM, abs=1e-6)


@pytest.mark.parametrize(("frequency", "degrees"), [(2, 31.8), (3, 23.9), (5, 14.1), (8, 9.2)])
def test_even_and_odd_viewpoints_lie_among_each_other(frequency: int, degrees: float) -> None:
    directions = icosphere(frequency)
    angles = np.degrees(np.arccos(np.clip(directions[::2] @ directions[1::2].T, -1.0, 1.0)))
    assert angles.min(axis=0).max() < degrees
    assert angles.min(axis=1).max() < degrees


@pytest.mark.parametrize("frequency", [1, 2, 3, 5, 8])
def test_the_icosphere_is_a_geodesic_polyhedron(frequency: int) -> None:
    directions = icosphere(frequency)
    assert len(directions) == 10 * frequency**2 + 2
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert np.allclose(directions.sum(axis=0), 0.0, atol=1e-9)
    cosines = directions @ directions.T - 3.0 * np.eye(len(directions))
    spacing = np.degrees(np.arccos(cosines.max(axis=1)))  # to the nearest neighbour
    assert spacing.max() < 1.45 * spacing.min()
    assert np.allclose(np.sort((-directions).round(6), axis=0), np.sort(directions.round(6), axis=0))  # point-symmetric


def test_no_icosphere_of_frequency_zero() -> None:
    with pytest.raises(ValueError, match="frequency"):
        icosphere(0)


def test_even_views_test_odd_ones_train_and_some_validate() -> None:
    splits = view_splits(252)
    assert all(split == "test" for split in splits[::2])
    assert splits.count("validation") == 14
    assert splits.count("train") == 112


@pytest.mark.parametrize("size", [(256, 256), (200, 100), (100, 300)])
def test_the_bounding_sphere_fills_the_frame(size: tuple[int, int]) -> None:
    width, height = size
    for camera in orbit((1.0, -2.0, 3.0), 2.5, width=width, height=height, fill=0.9, frequency=1):
        pixels, _ = camera.project([(1.0, -2.0, 3.0)])
        assert pixels[0] == pytest.approx((width / 2, height / 2), abs=1e-9)
        distance = np.linalg.norm(camera.position - (1.0, -2.0, 3.0))
        silhouette = camera.fy * math.tan(math.asin(2.5 / distance))
        assert silhouette == pytest.approx(0.9 * min(width, height) / 2)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (1e-3, 0, 1), (0, 1, 0), (1, 1, 1), (0.1, 0.05, -1)])
def test_cameras_at_the_poles_are_proper_rotations(direction: tuple[float, float, float]) -> None:
    camera = Camera.look_at(direction, (0, 0, 0), vertical_fov_degrees=30.0, width=10, height=10)
    assert np.allclose(camera.rotation @ camera.rotation.T, np.eye(3))
    assert np.linalg.det(camera.rotation) == pytest.approx(1.0)
    assert np.allclose(camera.forward, -np.array(direction) / np.linalg.norm(direction))


def test_up_is_up() -> None:
    camera = Camera.look_at((3, 1, 0.5), (0, 0, 0), vertical_fov_degrees=30.0, width=10, height=10)
    pixels, _ = camera.project([(0, 0, 0.1), (0, 0, -0.1)])
    assert pixels[0, 1] < 5.0 < pixels[1, 1]


@given(
    position=points, target=points, pixel=st.tuples(st.integers(0, 30), st.integers(0, 20)), far=st.floats(0.1, 100.0)
)
def test_rays_and_projection_are_inverse(
    position: tuple[float, float, float], target: tuple[float, float, float], pixel: tuple[int, int], far: float
) -> None:
    if np.linalg.norm(np.subtract(position, target)) < 1e-3:
        return
    camera = Camera.look_at(position, target, vertical_fov_degrees=40.0, width=31, height=21)
    origin, directions = camera.rays()
    column, row = pixel
    pixels, depth = camera.project([origin + far * directions[row, column]])
    assert pixels[0] == pytest.approx((column + 0.5, row + 0.5), abs=1e-5)
    assert depth[0] > 0
    assert np.allclose(camera.position, position, atol=1e-9)


@given(position=points)
def test_json_keeps_every_bit(position: tuple[float, float, float]) -> None:
    if np.linalg.norm(position) < 1e-3:
        return
    camera = Camera.look_at(position, (0, 0, 0), vertical_fov_degrees=33.3, width=7, height=9)
    again = Camera.from_json(json.loads(json.dumps(camera.to_json())))
    assert np.array_equal(again.world_to_camera, camera.world_to_camera)
    assert again.to_json() == camera.to_json()


def test_resizing_keeps_the_view() -> None:
    camera = Camera.look_at((3, 2, 1), (0, 0, 0), vertical_fov_degrees=30.0, width=40, height=20)
    small, large = camera.project([(0.1, 0.2, 0.3)])[0], camera.resized(80, 40).project([(0.1, 0.2, 0.3)])[0]
    assert np.allclose(2 * small, large)
    assert camera.resized(80, 40).vertical_fov_degrees == pytest.approx(camera.vertical_fov_degrees)


@pytest.mark.parametrize(
    ("matrix", "fx", "width"),
    [
        (np.diag([1.0, 1.0, 2.0, 1.0]), 1.0, 4),
        (np.diag([1.0, 1.0, -1.0, 1.0]), 1.0, 4),
        (np.full((4, 4), np.nan), 1.0, 4),
        (np.eye(3), 1.0, 4),
        (np.eye(4), 0.0, 4),
        (np.eye(4), 1.0, 0),
    ],
)
def test_what_is_no_camera_is_refused(matrix: np.ndarray, fx: float, width: int) -> None:
    with pytest.raises(ValueError, match="must"):
        Camera(matrix, fx, 1.0, 0.0, 0.0, width, 4)


def test_looking_at_oneself_is_refused() -> None:
    with pytest.raises(ValueError, match="coincide"):
        Camera.look_at((1, 1, 1), (1, 1, 1), vertical_fov_degrees=30.0, width=4, height=4)


@pytest.mark.parametrize(
    ("direction", "angles"),
    [((1, 0, 0), (0, 90)), ((0, 1, 0), (90, 90)), ((0, 0, 1), (0, 0)), ((-1, 0, -1), (180, 135))],
)
def test_angles(direction: tuple[float, float, float], angles: tuple[float, float]) -> None:
    assert spherical_angles(direction) == pytest.approx(angles)
