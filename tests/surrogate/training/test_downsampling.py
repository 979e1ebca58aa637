"""Smaller pictures: means of blocks of pixels, seen through the same camera."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from catalogs.vocabulary.cameras import Camera
from surrogate.training.data import Example
from surrogate.training.downsampling import Downsampling, block_means, downsampled, fitting_factor, shares


def camera(width: int, height: int) -> Camera:
    return Camera.look_at((0.4, -3.0, 0.7), (0, 0, 0), vertical_fov_degrees=40.0, width=width, height=height)


def example(width: int, height: int, seed: int = 0) -> Example:
    """Noise, premultiplied."""
    random = np.random.default_rng(seed)
    alpha = random.integers(0, 256, (height, width, 1), np.uint8)
    rgb = np.minimum(random.integers(0, 256, (height, width, 3), np.uint8), alpha)
    return Example(camera(width, height), torch.zeros(1), np.concatenate([rgb, alpha], axis=2), "noise")


@given(
    factor=st.sampled_from([1, 2, 4, 8]),
    rows=st.integers(1, 3),
    columns=st.integers(1, 3),
    channels=st.sampled_from([3, 4]),
    seed=st.integers(0, 99),
)
def test_a_block_becomes_its_rounded_mean(factor: int, rows: int, columns: int, channels: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    pixels = random.integers(0, 256, (rows * factor, columns * factor, channels), np.uint8)
    means = pixels.reshape(rows, factor, columns, factor, channels).mean(axis=(1, 3), dtype=np.float64)
    np.testing.assert_array_equal(block_means(pixels, factor), np.floor(means + 0.5))


@pytest.mark.parametrize("factor", [2, 8])
def test_white_stays_white(factor: int) -> None:
    assert (block_means(np.full((32, 32, 4), 255, np.uint8), factor) == 255).all()


def test_the_camera_sees_the_same_and_colours_stay_premultiplied() -> None:
    whole = example(24, 16)
    small = downsampled(whole, 4)
    assert (small.camera.width, small.camera.height, small.pixels.shape) == (6, 4, (4, 6, 4))
    assert (small.pixels[..., :3] <= small.pixels[..., 3:]).all()
    points = np.array([[0.1, 0.2, -0.3], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(small.camera.project(points)[0], whole.camera.project(points)[0] / 4.0)


@pytest.mark.parametrize(("width", "height", "factor"), [(24, 16, 1), (24, 18, 4), (23, 16, 2)])
def test_a_picture_that_blocks_do_not_fit_stays(width: int, height: int, factor: int) -> None:
    whole = example(width, height)
    assert downsampled(whole, factor) is whole


@pytest.mark.parametrize(
    ("sizes", "factor"),
    [
        ([(96, 96)], 1),
        ([(255, 255)], 1),
        ([(256, 256)], 2),
        ([(512, 512)], 4),
        ([(1024, 1024)], 8),
        ([(4096, 4096)], 8),
        ([(1024, 512)], 4),
        ([(1024, 1024), (512, 512)], 4),
        ([(1000, 600)], 4),
        ([(518, 1024)], 2),
        ([(1024, 510)], 2),
        ([(513, 512)], 1),
    ],
)
def test_the_factor_divides_all_pictures_and_leaves_some_pixels(sizes: list[tuple[int, int]], factor: int) -> None:
    assert fitting_factor(camera(*size) for size in sizes) == factor


@pytest.mark.parametrize(
    ("factor", "ends"),
    [(1, {1: 1000}), (2, {2: 700, 1: 1000}), (4, {4: 700, 2: 850, 1: 1000}), (8, {8: 700, 4: 800, 2: 900, 1: 1000})],
)
def test_pictures_grow_while_rates_fall(factor: int, ends: dict[int, int]) -> None:
    downsampling = Downsampling(factor, 1000)
    of_steps = [downsampling.at(step) for step in range(1000)]
    assert of_steps == sorted(of_steps, reverse=True)
    for each, share in shares(factor):
        assert of_steps.count(each) == pytest.approx(1000 * share, abs=1)
    for each, end in ends.items():
        assert max(step for step in range(1000) if of_steps[step] == each) == pytest.approx(end - 1, abs=1)
    assert downsampling.at(5_000) == 1
    assert Downsampling(factor, 1).at(0) == factor
