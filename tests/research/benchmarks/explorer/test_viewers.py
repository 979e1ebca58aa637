"""Files of Gaussians are read again, and drawn by the rule of other viewers as the reference implementation draws them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera, orbit
from research.benchmarks.explorer.viewers import between, drawn, of_glb, of_spz
from surrogate.explore.exporting.glb import glb_bytes
from surrogate.explore.exporting.splats import Splats
from surrogate.explore.exporting.spz import spz_bytes
from surrogate.splatting import render
from tests.support.surrogates import some_surrogate

CAMERA = Camera.look_at((6.0, 2.0, 3.0), (0.0, 0.0, 0.0), vertical_fov_degrees=25, width=40, height=32)


def splats() -> Splats:
    made = Splats.of(some_surrogate().at(Re=1830.0, time=0.4))
    return replace(made, means=(made.means - made.means.mean(axis=0)) / 40.0, scales=made.scales / 40.0)


@pytest.mark.parametrize("dilation", [0.0, 0.3])
def test_pictures_are_those_of_the_reference_but_for_the_cut(dilation: float) -> None:
    own = splats()
    arrays = (own.means, own.scales, own.quats, own.opacities, own.coefficients[:, 0].clip(min=0.0))
    tensors = [torch.from_numpy(array) for array in arrays]
    options = {"dilation": dilation, "alpha_floor": 1e-9, "alpha_cap": 0.99999, "near": 1e-3}
    expected = render(*tensors, CAMERA, backend="reference", **options).over((1.0, 1.0, 1.0)).numpy().clip(0.0, 1.0)
    found = drawn(of_glb(glb_bytes(own)), CAMERA, dilation)
    assert np.ptp(expected) > 0.3
    assert (
        np.sqrt(((found - expected) ** 2).mean()) < 0.01
    )  # what lies beyond three standard deviations: exp(-4.5) = 0.011


def test_both_files_show_the_same() -> None:
    own = splats()
    glb, spz = of_glb(glb_bytes(own)), of_spz(spz_bytes(own))
    for name in ("means", "opacities", "colors"):
        np.testing.assert_allclose(spz[name], glb[name], atol=5e-3)
    assert np.abs((spz["quats"] * glb["quats"]).sum(1)).min() > 1.0 - 1e-5
    assert np.sqrt(((drawn(spz, CAMERA) - drawn(glb, CAMERA)) ** 2).mean()) < 0.01


def test_unseen_views_lie_between_stored_ones() -> None:
    center = np.array([1.0, 2.0, 3.0])
    stored = orbit(center, 1.0, width=8, height=8)
    positions = np.array([camera.position for camera in stored])
    for camera in between(stored, center, 5):
        distances = np.sort(np.linalg.norm(positions - camera.position, axis=1))
        assert distances[0] > 0.0
        assert distances[1] == pytest.approx(distances[0], rel=0.05)
        away = camera.rotation @ center + camera.world_to_camera[:3, 3]
        assert np.allclose(away[:2], 0.0, atol=1e-9)
