"""Drawing of training pictures by GS-Surrogate: hard ones more often."""

from __future__ import annotations

import numpy as np
import pytest

from research.studies.baselines.gs_surrogate import HardMining
from research.studies.baselines.method import Plan


def frequencies(mining: HardMining, pictures: int, draws: int = 4000) -> np.ndarray:
    """The fraction of draws of each picture, at constant chances."""
    drawn = [mining.drawn(step) for step in range(10_000, 10_000 + draws)]
    return np.bincount(drawn, minlength=pictures) / draws


def test_pictures_are_drawn_in_proportion_to_a_power_of_their_last_losses() -> None:
    losses = np.array([0.1, 0.4, 0.2, 0.8])
    mining = HardMining(5, Plan(400), 1.5)  # renewed after every tenth step
    for picture, loss in enumerate(losses):
        mining.tell(3, picture, 5.0 * loss)
        mining.tell(9, picture, loss)
    np.testing.assert_allclose(frequencies(mining, 5), 0.2, atol=0.03)
    mining.tell(20, 3, losses[3])
    expected = np.append(losses, 1.0) ** 1.5  # one that was never drawn counts as 1
    np.testing.assert_allclose(frequencies(mining, 5), expected / expected.sum(), atol=0.03)


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_mining_begins_in_short_plans_too_and_survives_perfect_pictures(steps: int) -> None:
    mining = HardMining(3, Plan(steps), 1.5)
    for picture, loss in enumerate([0.0, -1e-9, 0.5]):
        mining.tell(1, picture, loss)
    assert frequencies(mining, 3)[2] > 0.99
    for picture in range(3):
        mining.tell(2, picture, 0.0)
    np.testing.assert_allclose(frequencies(mining, 3), 1.0 / 3.0, atol=0.03)


def test_pictures_of_a_group_share_the_moving_mean_of_their_losses() -> None:
    mining = HardMining(5, Plan(400), 1.5, groups=np.array([0, 0, 1, 1, 2]), official_steps=160_000)
    for step, (picture, loss) in enumerate([(0, 1.0), (1, 0.5), (0, 0.2), (2, 3.0), (1, 0.4)], start=1):
        mining.tell(step, picture, loss)  # renewed after the fifth step
    means = [0.9 * (0.9 * (0.9 * 1.0 + 0.05) + 0.02) + 0.04, 3.0, 1.0]  # one that was never drawn counts as 1
    expected = np.array(means)[[0, 0, 1, 1, 2]] ** 1.5
    np.testing.assert_allclose(frequencies(mining, 5), expected / expected.sum(), atol=0.03)
    again = HardMining(5, Plan(400), 1.5, groups=np.array([0, 0, 1, 1, 2]), official_steps=160_000)
    again.restore({name: tensor.clone() for name, tensor in mining.state().items()})
    assert [again.drawn(step) for step in range(50)] == [mining.drawn(step) for step in range(50)]
    for sampler in (mining, again):
        sampler.tell(10, 4, 0.1)
    assert [again.drawn(step) for step in range(50)] == [mining.drawn(step) for step in range(50)]
