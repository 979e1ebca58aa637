"""Cameras that see what stored ones see."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera
from surrogate.answers.views import FACTOR, Views

MIDDLE = np.array([100.0, -50.0, 3.0])


def camera(*direction: float, distance: float = 10.0, field: float = 30.0, aside: float = 0.0) -> Camera:
    towards = np.array(direction) / np.linalg.norm(direction)
    side = np.cross(towards, [0.3, 0.2, 0.9])
    target = MIDDLE + aside * side / np.linalg.norm(side)
    return Camera.look_at(
        target + distance * towards, target, vertical_fov_degrees=field, width=40, height=20, up=(0.3, 0.2, 0.9)
    )


AXES = [camera(*axis) for axis in np.concatenate([np.eye(3), -np.eye(3)]).tolist()]
HALF = [camera(np.cos(a), np.sin(a), 0.0) for a in np.radians([0, 20, 40, 60])]


@pytest.mark.parametrize(
    ("stored", "seen", "covered"),
    [
        (AXES, camera(1, 1, 1), True),  # between them
        (AXES, camera(1, 0, 0, distance=10 * 0.99 * FACTOR), True),
        (AXES, camera(1, 0, 0, distance=10 * 1.01 * FACTOR), False),
        (AXES, camera(1, 0, 0, distance=10 / 1.01 / FACTOR), False),
        (AXES, camera(1, 0, 0, distance=5, field=57.0), False),  # as much is seen, but from nearby
        (AXES, camera(1, 0, 0, field=40.0), False),
        (AXES, camera(1, 0, 0, aside=0.6), True),
        (AXES, camera(1, 0, 0, aside=0.8), False),
        (HALF, camera(1, 0.2, 0.1), True),
        (HALF, camera(1, 0, 1), False),
        (HALF[:1], camera(1, 0.001, 0), True),
        (HALF[:1], camera(1, 0.1, 0), False),
    ],
)
def test_a_view_is_covered_or_not(stored: list[Camera], seen: Camera, covered: bool) -> None:
    views = Views.of(stored, MIDDLE)
    assert views is not None
    assert views.cover(seen) == covered


def test_a_size_in_pixels_does_not_matter() -> None:
    views = Views.of(AXES, MIDDLE)
    assert views is not None
    assert views.cover(AXES[0].resized(400, 200))
    assert all(map(views.cover, AXES))


def test_without_cameras_there_are_none() -> None:
    assert Views.of([], MIDDLE) is None
