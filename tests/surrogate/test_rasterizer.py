"""The number of samples in a pixel: as many as in training, more on surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Gaussians
from surrogate.lighting import Lighting
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from tests.support.visualizations import base

CAMERA = Camera.look_at((3.0, 1.0, 2.0), (0.0, 0.0, 0.0), vertical_fov_degrees=40.0, width=9, height=6)
LIT = Lighting((0.9, 0.5, 0.2), 0.2, 0.7, 0.1, 20.0)


def volume() -> Gaussians:
    return base().gaussians


def surface() -> Gaussians:
    return replace(volume(), lighting=LIT)


def by_hand(gaussians: Gaussians, samples: int) -> np.ndarray:
    """Each pixel is the mean of an image that is `samples` times as large."""
    fine = Rasterizer().draw(gaussians, CAMERA.resized(samples * CAMERA.width, samples * CAMERA.height))
    whole = torch.cat([fine.color, fine.alpha[..., None]], dim=2).numpy()
    return whole.reshape(CAMERA.height, samples, CAMERA.width, samples, 4).mean(axis=(1, 3))


@pytest.mark.parametrize("backend", ["auto", "reference"])
def test_surfaces_and_volumes_have_their_own_samples(backend: str) -> None:
    rasterizer = Rasterizer(backend=backend, samples=3, surface_samples=2)
    for gaussians, samples in ((volume(), 3), (surface(), 2)):
        expected = by_hand(gaussians, samples)
        assert abs(expected - by_hand(gaussians, 1)).max() > 1e-3
        drawn = rasterizer.draw(gaussians, CAMERA)
        assert drawn.color.numpy() == pytest.approx(expected[..., :3], abs=1e-5)
        assert drawn.alpha.numpy() == pytest.approx(expected[..., 3], abs=1e-5)
        compared = rasterizer.draw_over(gaussians, CAMERA, (1.0, 0.5, 0.25)).numpy()
        behind = (1.0 - expected[..., 3:]) * np.array([1.0, 0.5, 0.25])
        assert compared[..., :3] == pytest.approx(expected[..., :3] + behind, abs=1e-5)
        assert compared[..., 3] == pytest.approx(expected[..., 3], abs=1e-5)


def test_surfaces_are_trained_with_four_samples_a_pixel_and_volumes_with_one() -> None:
    assert Rasterizer.of(TrainingSettings()) == Rasterizer(samples=1, surface_samples=2)
    assert Rasterizer.of(TrainingSettings(samples=2, surface_samples=1)) == Rasterizer(samples=2, surface_samples=1)


def test_samples_are_stored() -> None:
    rasterizer = Rasterizer(samples=2, surface_samples=3)
    assert Rasterizer.from_json(rasterizer.to_json()) == rasterizer


@pytest.mark.parametrize("number", [0, 5, -1, 10**9, 2.0, True, "2", None])
def test_a_file_has_no_other_number_of_samples(number: object) -> None:
    with pytest.raises(ValueError, match=r"surface_samples must be an integer from 1 to 4, got"):
        Rasterizer.from_json({**Rasterizer().to_json(), "surface_samples": number})
