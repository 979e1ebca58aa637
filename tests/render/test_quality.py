"""The sample distance is what it was measured to be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import orbit
from render import choose_sample_distance, render_views
from render.datasets import to_grid
from render.grids import Grid
from render.quality import WholeField, choose_for_ensemble, psnr, spread
from tests.support.raymarch import march


def cameras(grid: Grid, size: int = 48):
    return orbit(grid.center, grid.bounding_radius, width=size, height=size, frequency=2)


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["smooth", "peaks"])
@pytest.mark.parametrize("target", [40.0, 50.0])
def test_the_chosen_distance_meets_the_target_against_the_ray_marcher(gyroid, profile, target, request) -> None:
    appearance = VolumeRendering("dvr", request.getfixturevalue(profile))
    chosen = choose_sample_distance(gyroid, appearance, cameras(gyroid), target)
    assert chosen.decibels >= target
    for camera in cameras(gyroid)[3::17]:  # views it was not measured on
        truth = march(gyroid, appearance, camera, min(gyroid.spacing) / 24)
        image = next(render_views(gyroid, appearance, [camera], sample_distance=chosen.distance))
        assert psnr(image / 255, truth) >= target - 1


def test_a_harder_target_takes_smaller_steps(gyroid, peaks) -> None:
    appearance = VolumeRendering("dvr", peaks)
    distances = [choose_sample_distance(gyroid, appearance, cameras(gyroid), t).distance for t in (30, 40, 50)]
    assert distances[0] > distances[1] > distances[2]


def test_thin_grids_are_sampled_within_half_their_smallest_spacing(smooth) -> None:
    grid = to_grid(np.full((5, 5, 5), 0.5), spacing=(1.0, 1.0, 0.05))
    chosen = choose_sample_distance(grid, VolumeRendering("dvr", smooth), cameras(grid), 30.0)
    assert chosen.distance <= 0.025


def test_a_target_out_of_reach_is_said(gyroid) -> None:
    spikes = TransferFunction(((-1, 1, 1, 1), (1, 1, 1, 1)), ((-1, 0), (0.0, 0), (0.004, 1), (0.008, 0), (1, 0)), 0.001)
    with pytest.warns(
        UserWarning, match=r"no sample distance reaches 55.0 dB with 1.5 dB .* features finer than the grid"
    ):
        choose_sample_distance(gyroid, VolumeRendering("spikes", spikes), cameras(gyroid), 55.0)


def test_an_isosurface_needs_no_steps(gyroid) -> None:
    chosen = choose_sample_distance(gyroid, Isosurface("iso", 0.1), cameras(gyroid))
    assert math.isinf(chosen.decibels)


@pytest.mark.parametrize(("target", "count"), [(59.0, 3), (0.0, 3), (math.nan, 3), (50.0, 0)])
def test_what_is_refused(gyroid, smooth, target: float, count: int) -> None:
    with pytest.raises(ValueError, match=r"target_decibels|at least one camera"):
        choose_sample_distance(gyroid, VolumeRendering("dvr", smooth), cameras(gyroid)[:count], target)


def test_cameras_may_have_different_sizes(gyroid, smooth) -> None:
    mixed = cameras(gyroid, 32)[:20] + cameras(gyroid, 24)[20:]
    assert choose_sample_distance(gyroid, VolumeRendering("dvr", smooth), mixed, 40.0).decibels > 40


def test_views_are_spread_over_the_sequence() -> None:
    assert spread(list(range(252)), 4) == [31, 94, 157, 220]
    assert spread([7], 4) == [7]


def test_psnr_by_its_definition() -> None:
    assert psnr(np.full((2, 2), 0.1), np.zeros((2, 2))) == pytest.approx(20.0)
    assert psnr(np.ones(3), np.ones(3)) == math.inf


@pytest.mark.parametrize("profile", ["smooth", "peaks"])
def test_choosing_costs_less_than_a_tenth_of_a_member(gyroid, profile, request, monkeypatch) -> None:
    appearance = VolumeRendering("dvr", request.getfixturevalue(profile))
    samples = []

    def pictures(self, appearance, cameras, sample_distance, *, float_output):
        samples.append(sum(camera.width * camera.height for camera in cameras) / sample_distance)
        return own(self, appearance, cameras, sample_distance, float_output=float_output)

    own = WholeField.pictures
    monkeypatch.setattr(WholeField, "pictures", pictures)
    chosen = choose_for_ensemble(gyroid, appearance, cameras(gyroid, 256), 50.0)
    assert sum(samples) < 25 * 256**2 / chosen.distance  # of 252 views


def test_steps_are_as_long_as_the_target_allows(gyroid, smooth) -> None:
    """Samples closer than spacings are for those who ask for more."""
    appearance = VolumeRendering("dvr", smooth)
    chosen = choose_for_ensemble(gyroid, appearance, cameras(gyroid), 40.0)
    assert chosen.distance > 1.5 * min(gyroid.spacing)
    assert 40 < chosen.decibels < 52
