"""Pictures at other sizes and distances: cameras move as they say, and a perfect prediction errs nowhere but enlarged."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera, orbit
from research.benchmarks.splatting.zoom import DISTANCES, SIZES, enlarged, errors, farther, resized

CENTER = np.array([1.0, 2.0, 3.0])
CAMERA = orbit(CENTER, 1.0, width=16, height=12)[7]


def of_rays(camera: Camera) -> np.ndarray:
    """An opaque picture whose colours vary with the rays' directions."""
    _, directions = camera.rays()
    colors = 0.5 + 0.4 * np.sin(12.0 * np.asarray(directions).reshape(camera.height, camera.width, 3))
    return np.concatenate([colors, np.ones_like(colors[..., :1])], -1).astype(np.float32)


@pytest.mark.parametrize("factor", DISTANCES)
def test_a_camera_moves_along_its_own_axis(factor: float) -> None:
    moved = farther(CAMERA, factor, CENTER)
    np.testing.assert_allclose(moved.position - CENTER, factor * (CAMERA.position - CENTER))
    np.testing.assert_allclose(moved.rotation, CAMERA.rotation)
    (before, _), (after, _) = CAMERA.project(CENTER[None]), moved.project(CENTER[None])
    np.testing.assert_allclose(before, after, atol=1e-9)


@pytest.mark.parametrize("factor", SIZES)
def test_a_size_keeps_the_frame(factor: float) -> None:
    other = resized(CAMERA, factor)
    assert (other.width, other.height) == (16 * factor, 12 * factor)
    (before, _), (after, _) = CAMERA.project(CENTER[None]), other.project(CENTER[None])
    np.testing.assert_allclose(factor * before, after)


def test_an_even_picture_stays_even_when_enlarged() -> None:
    assert enlarged(np.full((3, 5, 3), 0.25, np.float32), 2.0) == pytest.approx(np.full((6, 10, 3), 0.25))


def test_a_perfect_prediction_errs_only_where_it_is_enlarged() -> None:
    found = np.array(errors(of_rays, of_rays, CAMERA, CENTER))
    by_size, bicubic = len(SIZES), 2
    assert found.shape == (by_size + bicubic + len(DISTANCES),)
    assert (np.delete(found, [by_size, by_size + 1]) == 0.0).all()
    assert (found[by_size : by_size + bicubic] > 0.0).all()
