"""The part of an image that a sheet enlarges."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.report.sheets import worst_window


@pytest.mark.parametrize("shape", [(40, 60), (300, 280), (3, 2)])
def test_the_worst_window_is_the_one_of_the_largest_error(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(1)
    truth, prediction = (random.random((*shape, 3)).astype(np.float32) for _ in range(2))
    top, left, size = worst_window(truth, prediction)
    assert size == max(1, min(64, min(shape) // 4))
    errors = ((truth.astype(np.float64) - prediction) ** 2).sum(axis=-1)
    windows = np.lib.stride_tricks.sliding_window_view(errors, (size, size)).sum(axis=(2, 3))
    assert windows[top, left] == pytest.approx(windows.max(), rel=1e-9)


def test_identical_pictures_have_a_window_too() -> None:
    picture = np.ones((8, 8, 3), np.float32)
    assert worst_window(picture, picture) == (0, 0, 2)
