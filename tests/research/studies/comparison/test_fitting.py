"""Trainings end when their time does, by a clock that stands while others look."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from research.studies.baselines.method import Fit, Plan
from research.studies.comparison.fitting import (
    LOOKS,
    CheckpointPath,
    FinishedFit,
    OutOfTime,
    Watch,
    fit_in_time,
    steps_in,
)
from surrogate.training.loop import Diverged
from tests.research.support.baseline_scenes import ball_pictures
from tests.research.support.mean_pictures import mean_method

PICTURES = ball_pictures([[0.0], [1.0]], views=2)


class Hand:
    """A clock that others turn."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def taking(hand: Hand, seconds: float):
    """A loss that takes this number of seconds."""

    def loss(_: int) -> float:
        hand.now += seconds
        return 0.25

    return loss


def test_a_watch_stands_still_while_it_is_stopped() -> None:
    hand = Hand()
    watch = Watch(hand)
    assert watch.seconds == 0.0
    watch.start()
    hand.now += 2.0
    assert watch.seconds == 2.0
    watch.stop()
    hand.now += 5.0
    watch.start()
    hand.now += 0.5
    watch.stop()
    assert watch.seconds == 2.5


@pytest.mark.parametrize(("seconds", "pace", "steps"), [(60.0, 0.5, 120), (10.0, 1.0, 10), (1.0, 5.0, 1)])
def test_as_many_steps_are_planned_as_fit(seconds: float, pace: float, steps: int) -> None:
    hand = Hand()
    method = mean_method(loss=taking(hand, pace))
    assert steps_in(method, PICTURES, Plan(1), {}, seconds, hand) == pytest.approx(steps, abs=1)


def test_the_pace_is_that_of_the_whole_schedule() -> None:
    """The second half of the steps takes three times as long as the first."""
    hand = Hand()

    class Slowing:
        def __init__(self, plan: Plan) -> None:
            self.plan, self.step = plan, 0

        def advance(self) -> float:
            hand.now += 0.1 if self.step < self.plan.steps / 2 else 0.3
            self.step += 1
            return 0.0

    method = mean_method()
    slowing = type(method)("slow", "slow", "", 1, lambda _, plan, __: Slowing(plan), None)
    assert steps_in(slowing, PICTURES, Plan(1), {}, 100.0, hand) == pytest.approx(500, rel=0.05)


def test_looks_are_off_the_clock_and_loading_is_on_it() -> None:
    hand = Hand()
    method, looked = mean_method(loss=taking(hand, 0.1)), []

    def pictures():
        hand.now += 3.0
        return PICTURES

    def look(fit: Fit) -> float:
        hand.now += 1000.0
        looked.append(fit)
        return float(len(looked))

    found = fit_in_time(method, pictures, Plan(1, seed=7, rate=0.5), {}, 13.0, look, clock=hand)
    assert found.plan == Plan(found.plan.steps, seed=7, rate=0.5)
    assert found.seconds == pytest.approx(3.0 + 0.1 * found.plan.steps)
    assert found.seconds == pytest.approx(13.0, abs=0.5)
    assert [psnr for _, psnr in found.curve] == [1.0 + k for k in range(len(LOOKS))]
    assert found.curve[-1][0] == pytest.approx(found.seconds)
    seconds = [at for at, _ in found.curve]
    assert seconds == sorted(seconds)
    assert found.fit is looked[-1]


@pytest.mark.parametrize("loss", [math.nan, math.inf])
def test_a_loss_that_is_no_number_ends_the_training(loss: float) -> None:
    hand = Hand()
    turning = taking(hand, 1.0)

    def diverging(step: int) -> float:
        turning(step)
        return loss if step > 3 else 0.5

    with pytest.raises(Diverged, match=r"The mean diverged at step .* its loss is"):
        fit_in_time(mean_method(loss=diverging), lambda: PICTURES, Plan(1), {}, 64.0, clock=hand)


def test_an_interrupted_training_ends_as_if_it_had_gone_on(tmp_path: Path) -> None:
    def trained(place: CheckpointPath | None, hand: Hand) -> FinishedFit:
        def look(fit: Fit) -> float:
            return float(fit.tensors()["mean"].mean())

        method = mean_method(loss=taking(hand, 1.0))
        return fit_in_time(method, lambda: PICTURES, Plan(1, seed=3), {}, 64.0, look, clock=hand, place=place)

    whole, hand = trained(None, Hand()), Hand()
    stopping = CheckpointPath(tmp_path, "the same", until=time.monotonic())
    with pytest.raises(OutOfTime):
        trained(stopping, hand)
    kept = stopping.checkpoint()
    assert kept is not None
    assert 1 <= kept.record["step"] < whole.plan.steps
    resumed = trained(CheckpointPath(tmp_path, "the same"), hand)
    assert resumed.plan == whole.plan
    assert resumed.seconds == pytest.approx(whole.seconds)
    np.testing.assert_allclose(resumed.curve, whole.curve)
    assert torch.equal(resumed.fit.tensors()["mean"], whole.fit.tensors()["mean"])


def test_a_checkpoint_of_something_else_is_none(tmp_path: Path) -> None:
    with pytest.raises(OutOfTime):
        fit_in_time(
            mean_method(),
            lambda: PICTURES,
            Plan(9),
            {},
            None,
            place=CheckpointPath(tmp_path, "one", until=time.monotonic()),
        )
    assert CheckpointPath(tmp_path, "one").checkpoint() is not None
    assert CheckpointPath(tmp_path, "other").checkpoint() is None


def test_without_a_time_the_planned_steps_are_made() -> None:
    assert fit_in_time(mean_method(), lambda: PICTURES, Plan(17), {}, None).plan.steps == 17


def test_time_for_less_than_a_step_is_a_step() -> None:
    hand = Hand()
    found = fit_in_time(
        mean_method(loss=taking(hand, 50.0)), lambda: PICTURES, Plan(1), {}, 1.0, lambda _: 20.0, clock=hand
    )
    assert found.plan.steps == 1
    assert [psnr for _, psnr in found.curve] == [20.0]
