"""Which cameras see what stored ones see."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera
from surrogate.explore.reliability.views import FACTOR, Views

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
    ("stored", "seen", "reason"),
    [
        (AXES, camera(1, 1, 1), ""),  # between them
        (AXES, camera(1, 0, 0, distance=10 * 0.99 * FACTOR), ""),
        (AXES, camera(1, 0, 0, distance=10 * 1.01 * FACTOR), "farther away"),
        (AXES, camera(1, 0, 0, distance=10 / 1.01 / FACTOR), "nearer"),
        (AXES, camera(1, 0, 0, distance=5, field=57.0), "nearer"),  # as much is seen, but from nearby
        (AXES, camera(1, 0, 0, field=40.0), "farther away"),
        (AXES, camera(1, 0, 0, aside=0.6), ""),
        (AXES, camera(1, 0, 0, aside=0.8), "off the picture's centre"),
        (HALF, camera(1, 0.2, 0.1), ""),
        (HALF, camera(1, 0, 1), "looks from 45° aside"),
        (HALF[:1], camera(1, 0.001, 0), ""),
        (HALF[:1], camera(1, 0.1, 0), "looks from 6° aside"),
    ],
)
def test_reasons(stored: list[Camera], seen: Camera, reason: str) -> None:
    views = Views.of(stored, MIDDLE)
    assert views is not None
    assert len(views.unlike(seen)) == bool(reason)
    assert reason in " ".join(views.unlike(seen))


def test_a_size_in_pixels_is_no_reason() -> None:
    views = Views.of(AXES, MIDDLE)
    assert views is not None
    assert views.unlike(AXES[0].resized(400, 200)) == []
    assert all(views.unlike(one) == [] for one in AXES)


def test_without_cameras_there_are_none() -> None:
    assert Views.of([], MIDDLE) is None
