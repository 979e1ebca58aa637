"""Promises that hold for members drawn like those that calibrated them."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.answers.calibration import Calibration, Unseen


def drawn(count: int, seed: int) -> Unseen:
    """Three pictures of each member, which share most of their error."""
    random = np.random.default_rng(seed)
    agreements = 35.0 + 5.0 * random.standard_normal((count, 1)) + 0.3 * random.standard_normal((count, 3))
    off = 1.5 * random.standard_normal((count, 1)) + 0.5 * random.standard_normal((count, 3))
    return Unseen(random.uniform(-1.0, 1.0, (count, 2)), agreements, agreements + 2.0 + off)


@pytest.mark.parametrize("count", [3, 4, 8, 9, 40])
def test_what_is_promised_holds(count: int) -> None:
    covered, promised = [], []
    for seed in range(60):
        calibration = Calibration.of(drawn(count, seed))
        assert calibration is not None
        others, line = drawn(200, 1000 + seed), calibration.line
        for point, agreement, truth in zip(others.points, others.agreements, others.truths, strict=True):
            covered.append((np.abs(truth - line.expected(agreement, point)) <= calibration.half).mean())
        promised.append(calibration.share)
    assert promised[0] == pytest.approx(min(0.9, count / (count + 1)))
    assert np.mean(covered) == pytest.approx(promised[0], abs=0.06)


def test_a_trend_over_parameters_counts_where_agreement_says_nothing() -> None:
    unseen = drawn(40, 0)
    truths = 30.0 + 8.0 * unseen.points[:, :1] + 0.0 * unseen.agreements
    calibration = Calibration.of(Unseen(unseen.points, unseen.agreements, truths))
    assert calibration is not None
    assert calibration.line.trend
    expected = calibration.line.expected(35.0, np.array([0.9, 0.0])) - calibration.line.expected(
        35.0, np.array([-0.9, 0.0])
    )
    assert expected == pytest.approx(14.4, abs=2.0)


def test_agreement_that_says_nothing_widens_no_interval() -> None:
    unseen = drawn(8, 0)
    calibration = Calibration.of(Unseen(unseen.points, unseen.agreements, 40.0 + 0.01 * unseen.agreements))
    assert calibration is not None
    assert (calibration.line.slope, calibration.half) == (0.0, pytest.approx(0.0, abs=0.3))


def test_too_few_members_promise_nothing() -> None:
    assert Calibration.of(drawn(2, 0)) is None


def test_records_are_read_again_and_damage_is_refused() -> None:
    calibration = Calibration.of(drawn(12, 0))
    assert calibration is not None
    assert Calibration.from_json(calibration.to_json()) == calibration
    with pytest.raises(ValueError, match="half"):
        Calibration.from_json({**calibration.to_json(), "half": "wide"})
