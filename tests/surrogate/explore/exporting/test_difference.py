from __future__ import annotations

import re

import matplotlib
import numpy as np
import pytest
from numpy.typing import NDArray
from skimage.metrics import peak_signal_noise_ratio

from surrogate.explore.exporting.difference import COLOR_MAP, difference_of


def pictures() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    random = np.random.default_rng(4)
    first = random.random((24, 40, 3), dtype=np.float32)
    second = np.clip(first + random.normal(0.0, 0.03, first.shape), 0.0, 1.0).astype(np.float32)
    return first, second


def test_the_numbers_are_those_of_the_largest_channel() -> None:
    first, second = pictures()
    found = difference_of(first, second)
    errors = np.abs(first.astype(np.float64) - second).max(axis=2)
    assert found.maximum == pytest.approx(errors.max(), rel=1e-6)
    assert found.psnr == pytest.approx(peak_signal_noise_ratio(first, second, data_range=1.0), abs=1e-4)
    assert found.high == 0.1  # 99.5 % of the largest of three lie below 0.1


def test_the_map_is_matplotlibs() -> None:
    first, second = pictures()
    found = difference_of(first, second)
    errors = np.abs(first - second).max(axis=2)
    np.testing.assert_allclose(found.picture, matplotlib.colormaps[COLOR_MAP](errors / found.high)[..., :3], atol=0.02)
    assert found.picture.dtype == np.float32
    clipped = found.picture[errors > found.high]
    assert len(clipped) > 0
    np.testing.assert_allclose(
        clipped, np.broadcast_to(matplotlib.colormaps[COLOR_MAP](1.0)[:3], clipped.shape), atol=1e-6
    )


def test_pictures_are_cut_before_they_are_compared() -> None:
    first, second = pictures()
    beyond = np.where(first > 0.5, 2.0 * first, first - 0.5)
    found, expected = difference_of(beyond, second), difference_of(np.clip(beyond, 0.0, 1.0), second)
    np.testing.assert_array_equal(found.picture, expected.picture)
    assert (found.psnr, found.maximum) == (expected.psnr, expected.maximum)
    assert found.maximum <= 1.0


@pytest.mark.parametrize("change", [0.0, 0.004, 0.012, 0.3, 1.0])
def test_the_range_holds_the_difference_and_is_a_round_number(change: float) -> None:
    first = np.zeros((8, 8, 3), np.float32)
    found = difference_of(first, first + np.array([0.0, 0.0, change], np.float32))
    assert found.high in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    assert change <= found.high + 1e-6
    assert found.high == 0.01 or change > found.high / 2.6
    assert found.maximum == pytest.approx(change)
    if change == 0.0:
        assert found.psnr == 60.0
        np.testing.assert_allclose(found.picture[0, 0], matplotlib.colormaps[COLOR_MAP](0)[:3], atol=1e-6)


def test_one_bright_pixel_does_not_darken_the_others() -> None:
    first, second = np.zeros((32, 32, 3), np.float32), np.full((32, 32, 3), 0.015, np.float32)
    second[3, 4] = 1.0
    found = difference_of(first, second)
    assert (found.high, found.maximum) == (0.02, 1.0)


@pytest.mark.parametrize(
    ("first", "second"), [((4, 4, 3), (4, 5, 3)), ((4, 4, 4), (4, 4, 4)), ((4, 4), (4, 4)), ((0, 4, 3), (0, 4, 3))]
)
def test_what_can_not_be_compared_is_named(first: tuple[int, ...], second: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=re.escape(f"of one size differ, got {first} and {second}")):
        difference_of(np.zeros(first, np.float32), np.zeros(second, np.float32))
