"""Distances of samples along rays: short where the transfer function is narrow, long where it is smooth."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native.ray_casting import SampledField, VolumeCaster, fitting_distance
from native.ray_casting.distances import SHORTEST

SIZE = 20
GRID = np.meshgrid(*[np.linspace(-1.0, 1.0, SIZE)] * 3, indexing="ij")
BLOB = np.exp(-sum(g**2 for g in GRID) / 0.5).astype(np.float32)
CAMERA = Camera.look_at((0.3, -7.0, 0.5), (0.5, 0.5, 0.5), vertical_fov_degrees=20.0, width=96, height=96)
COLORS = ((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.5, 0.0))


def volume(*points: tuple[float, float]) -> VolumeRendering:
    return VolumeRendering("v", TransferFunction(COLORS, points, 0.3))


def field(spacing: float = 1.0 / (SIZE - 1)) -> SampledField:
    return SampledField(BLOB, None, (spacing,) * 3, (0.0,) * 3)


def test_smooth_functions_take_long_distances_and_narrow_ones_short() -> None:
    spacing = 1.0 / (SIZE - 1)
    smooth = fitting_distance(field(), volume((0.0, 0.0), (1.0, 0.3)), CAMERA)
    narrow = fitting_distance(field(), volume((0.0, 0.0), (0.58, 0.0), (0.6, 0.9), (0.62, 0.0), (1.0, 0.0)), CAMERA)
    assert smooth == pytest.approx(spacing)
    assert SHORTEST * spacing <= narrow <= 0.25 * spacing


@pytest.mark.parametrize("width", [0.02, 0.1, 0.4])
def test_the_image_is_as_good_as_promised(width: float) -> None:
    peak = volume((0.0, 0.0), (0.5 - width, 0.0), (0.5, 0.8), (0.5 + width, 0.0), (1.0, 0.0))
    distance = fitting_distance(field(), peak, CAMERA)
    image, truth = (VolumeCaster.of(field(), peak, sample_distance=d).draw(CAMERA) for d in (distance, distance / 8.0))
    assert -10.0 * np.log10(np.mean((image - truth) ** 2.0)) > 46.0


def test_a_function_that_nothing_satisfies_ends_at_the_shortest() -> None:
    jump = volume((0.0, 0.0), (0.5, 0.0), (0.5 + 1e-9, 1.0), (1.0, 1.0))
    assert fitting_distance(field(), jump, CAMERA, decibels=200.0) == pytest.approx(SHORTEST / (SIZE - 1))
