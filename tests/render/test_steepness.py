"""The steepness of a field under a transfer function, against fields with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.appearance import TransferFunction
from render.datasets import to_grid
from render.steepness import SWEPT_IN, mean_change, swept

RAMP = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0)), ((0.0, 0.0), (1.0, 1.0)), 1.0)


@pytest.mark.parametrize("size", [8, 40])
def test_a_ramp_changes_by_its_slope(size: int) -> None:
    z = np.linspace(0.0, 1.0, size)[:, None, None] + np.zeros((size, size, size))
    # blue and opacity change by 1 / (size - 1) along one axis of three; red and green do not
    assert mean_change(to_grid(z), RAMP) == pytest.approx(np.sqrt(2 / 12) / (size - 1), rel=0.02)


@pytest.mark.parametrize("value", [-3.0, 0.5, 7.0])
def test_a_constant_does_not_change(value: float) -> None:
    assert mean_change(to_grid(np.full((6, 6, 6), value)), RAMP) == 0.0


def test_values_beyond_the_ends_do_not_count_nor_do_holes() -> None:
    field = np.random.default_rng(0).uniform(2.0, 9.0, (12, 12, 12))
    assert mean_change(to_grid(field), RAMP) == 0.0
    field[3:5, :, 2] = np.nan
    field[:, :, :2] = np.nan
    assert mean_change(to_grid(field, nan="transparent"), RAMP) == 0.0
    assert (
        mean_change(to_grid(np.where(np.indices(field.shape).sum(axis=0) % 2, np.nan, 0.5), nan="transparent"), RAMP)
        == 0
    )


def test_a_swept_field_shows_every_value_within_a_few_samples() -> None:
    grid = swept((1.0, 2.0, 3.0), RAMP)
    assert grid.spacing == (1.0, 2.0, 3.0)
    middle = grid.values[24, 24, 24:]
    assert middle[: SWEPT_IN + 1].min() < 0.05
    assert middle[: SWEPT_IN + 1].max() > 0.98
    assert np.abs(np.diff(middle)).max() < 0.2
