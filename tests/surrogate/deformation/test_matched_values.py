"""Another emulator that Gaussians follow from now on: at the members that the one before knew, values stay as they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from surrogate.appearance.scale import ValueScale
from surrogate.deformation.emulated_values import RIDGE, EmulatedValues
from tests.support.emulated_values import COUNT, MEMBERS, MODES, SCALE, emulated, processes


def another(scale: ValueScale | None, members: int) -> EmulatedValues:
    """Values of another emulator, with more members and less strong modes."""
    random = np.random.default_rng(7)
    known = processes()
    more = replace(
        known,
        points=np.vstack([known.points, random.uniform(-1.0, 1.0, (members, 2))]),
        coefficients=np.vstack([known.coefficients, random.standard_normal((members, MODES))]),
    )
    means = torch.full((COUNT,), 0.5 if scale is None else 2.0)
    return EmulatedValues(means, 0.1 * torch.ones(COUNT, MODES), more, scale)


@pytest.mark.parametrize("old", [SCALE, None])
@pytest.mark.parametrize("new", [SCALE, None])
def test_means_and_modes_are_those_of_a_ridge_regression(old: ValueScale | None, new: ValueScale | None) -> None:
    before, after = emulated(old), another(new, 4)
    matched = after.like(before)
    points = torch.from_numpy(before.processes.points)
    factors = np.stack([np.append(1.0, after.coefficients(point).numpy()) for point in points])  # [M, 1 + K]
    sizes = np.append(1.0, factors[:, 1:].std(axis=0))
    places = np.stack([before.carried(point).numpy() for point in points])  # [M, N]
    targets = places if new is None else new.values(places)
    own = np.hstack([after.means.numpy()[:, None], after.modes.numpy()])  # [N, 1 + K]
    ridge = np.sqrt(RIDGE * ((factors / sizes) ** 2).sum() / (1 + MODES))
    left = np.vstack([factors / sizes, ridge * np.eye(1 + MODES)])
    right = np.vstack([targets - factors @ own.T, np.zeros((1 + MODES, COUNT))])
    expected = own + (np.linalg.lstsq(left, right, rcond=None)[0] / sizes[:, None]).T  # [N, 1 + K]
    np.testing.assert_allclose(matched.means.numpy(), expected[:, 0], rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(matched.modes.numpy(), expected[:, 1:], rtol=1e-3, atol=1e-3)


def test_values_at_members_stay_nearly_and_others_follow_the_new_emulator() -> None:
    before, after = (
        replace(emulated(None), means=torch.full((COUNT,), 0.5), modes=0.1 * emulated(None).modes),
        another(None, 6),
    )
    matched = after.like(before)
    known, later = (torch.from_numpy(p) for p in np.split(after.processes.points, [MEMBERS]))
    farther, nearer = (
        max(float((v.carried(point) - before.carried(point)).abs().max()) for point in known) for v in (after, matched)
    )
    assert nearer < 0.2 * farther
    for point in later:
        assert float((matched.carried(point) - before.carried(point)).abs().max()) > 0.05


def test_the_same_emulator_changes_nothing() -> None:
    before = replace(emulated(None), means=torch.full((COUNT,), 0.5), modes=0.05 * emulated(None).modes)
    matched = before.like(before)
    torch.testing.assert_close(matched.means, before.means, atol=1e-6, rtol=0)
    torch.testing.assert_close(matched.modes, before.modes, atol=1e-6, rtol=0)
