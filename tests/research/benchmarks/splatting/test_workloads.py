"""The fixed workload is the one that its numbers are quoted for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from research.benchmarks.splatting.reference_patches import draw_patches, patches
from research.benchmarks.splatting.workloads import FIXED, OTHERS, Workload, thousands


def test_fixed_workload_is_as_deep_as_it_says() -> None:
    """256², 20,000 Gaussians, about 140 per covered pixel and at least 8.5 M pairs, from a quarter of the frame."""
    assert (FIXED.size, FIXED.count, FIXED.sigmas, FIXED.opacities) == (256, 20_000, (2, 6), (0.02, 0.2))
    counted = draw_patches(FIXED.view(), 256, gradients=False).counted
    assert counted.depth == pytest.approx(143, rel=0.05)
    assert counted.interactions / counted.pixels * 256**2 == pytest.approx(8.8e6, rel=0.05)


@pytest.mark.parametrize("workload", [FIXED, *OTHERS], ids=lambda w: w.title)
def test_standard_deviations_are_in_pixels_where_the_gaussian_stands(workload: Workload) -> None:
    scene, camera = workload.scene(), workload.camera()
    depths = torch.from_numpy(scene.means.double().numpy() @ camera.rotation[2] + camera.world_to_camera[2, 3])
    pixels = scene.scales * camera.fx / depths[:, None]
    assert pixels.min() >= workload.sigmas[0] * 0.9999
    assert pixels.max() <= workload.sigmas[1] * 1.0001
    assert pixels.max() > workload.sigmas[1] * 0.99
    low, high = workload.opacities
    assert low <= float(scene.opacities.min()) < float(scene.opacities.max()) <= high + 1e-6


def test_scenes_repeat() -> None:
    for first, second in zip(FIXED.scene(), FIXED.scene(), strict=True):
        assert torch.equal(first, second)


def test_larger_pictures_show_the_same_scene() -> None:
    small, large = replace(FIXED, count=50), replace(FIXED, count=50).at_size(1024)
    for name in ("means", "scales", "quats", "opacities", "colors"):
        torch.testing.assert_close(getattr(small.scene(), name), getattr(large.scene(), name))


def test_more_gaussians_fill_the_same_volume() -> None:
    few, many = FIXED.with_count(500).scene(), FIXED.with_count(4000).scene()
    volumes = [float(scene.scales.double().prod(1).sum()) for scene in (few, many)]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.1)


def test_titles() -> None:
    assert [thousands(n) for n in (500, 20_000, 1_000_000)] == ["500", "20k", "1M"]
    assert FIXED.title == "translucent, 256², 20k"


def test_patches_tile_the_frame() -> None:
    found = np.concatenate(patches(21, 13))
    assert sorted(found.tolist()) == list(range(21 * 13))
    some = patches(256, 256, 5)
    assert len(some) == 5
    assert all(len(patch) == 64 for patch in some)
