"""Grids are looked up like tables, and never outside their memory."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.interpolate import RegularGridInterpolator

from research.studies.baselines.lookup import bilinear
from surrogate.training.loop import Diverged


def test_entries_are_interpolated_and_the_border_goes_on() -> None:
    random = np.random.default_rng(0)
    grids, at = random.normal(size=(2, 3, 4, 5)), random.uniform(-1.5, 1.5, (2, 40, 2))
    found = bilinear(torch.from_numpy(grids), torch.from_numpy(at))
    down, across = np.linspace(-1.0, 1.0, 4), np.linspace(-1.0, 1.0, 5)
    for grid, points, values in zip(grids, np.clip(at, -1.0, 1.0), found.numpy(), strict=True):
        table = RegularGridInterpolator((down, across), np.moveaxis(grid, 0, -1))
        np.testing.assert_allclose(values.T, table(points[:, ::-1]), atol=1e-12)


@pytest.mark.parametrize("far", [math.inf, -math.inf, 1e30, -3.4e38])
def test_what_is_far_outside_is_the_border(far: float) -> None:
    found = bilinear(torch.arange(4.0).reshape(1, 1, 2, 2), torch.tensor([[[far, -1.0]]]))
    assert found.item() == (1.0 if far > 0 else 0.0)


def test_coordinates_that_are_no_numbers_end_a_training() -> None:
    at = torch.zeros(1, 5000, 2)
    at[0, 4321, 1] = math.nan
    with pytest.raises(Diverged, match="not finite"):
        bilinear(torch.zeros(1, 16, 64, 64), at)
