"""Things appear where the pinhole camera projects them, to far less than a pixel."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera
from research.benchmarks.rendering.accuracy import isosurface_projection_errors, volume_projection_error


def centred(camera: Camera) -> Camera:
    return camera


def off_centre_and_oblong(camera: Camera) -> Camera:
    width, height = camera.width, camera.height - 16
    return Camera(camera.world_to_camera, camera.fx, 1.1 * camera.fy, camera.cx + 17.3, camera.cy - 9.1, width, height)


@pytest.mark.slow
@pytest.mark.parametrize("transform", [centred, off_centre_and_oblong])
def test_volumes_within_a_hundredth_of_a_pixel(transform) -> None:
    assert volume_projection_error(transform) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("transform", [centred, off_centre_and_oblong])
def test_isosurfaces_within_a_hundredth_of_a_pixel_and_the_scatter_of_their_outline(transform) -> None:
    offsets = isosurface_projection_errors(transform)
    assert np.abs(offsets.mean(axis=0)).max() < 0.005
    assert np.abs(offsets).max() < 0.04
