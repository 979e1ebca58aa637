"""The learning curve predicts errors of emulators that learn from more members."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from surrogate.emulation import FieldEmulator
from surrogate.emulation.learning_curve import FEWEST_MEASURED, LearningCurve, TooFew


@pytest.fixture(autouse=True)
def few_repeats(monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of the subsets: what is held here does not need more, and each takes a fit."""
    monkeypatch.setattr("surrogate.emulation.learning_curve.REPEATS", 4)


def _ensemble(count: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Points (M, 2), and fields (M, 6, 6, 6) with creases that move: errors fall by a power of the number of members."""
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2))
    z, y, x = np.meshgrid(*3 * [np.linspace(0.0, 1.0, 6)], indexing="ij")
    creased = [np.abs(x - 0.5 - 0.4 * a) + np.abs(y + 0.5 * z - 0.7 - 0.5 * b) for a, b in points]
    return points, np.stack(creased).astype(np.float32)


def _decibels(emulator: FieldEmulator, points: NDArray[np.float64], fields: NDArray[np.float32]) -> float:
    errors = [((emulator.at(p).values - f) ** 2).mean() for p, f in zip(points, fields, strict=True)]
    return float(-10.0 * np.log10(np.array(errors)).mean())


@pytest.mark.slow(seconds=5)
def test_more_members_gain_what_was_expected() -> None:
    """Beside emulators that are fitted to 24 and to 48 members, over several draws of them."""
    unseen = _ensemble(60, 99)
    happened, expected, inside = [], [], 0
    for seed in range(4):
        points, fields = _ensemble(48, seed)
        few, many = (FieldEmulator.fit(points[:n], fields[:n], (1.0,) * 3, (0.0,) * 3) for n in (24, 48))
        happened.append(_decibels(many, *unseen) - _decibels(few, *unseen))
        gain = LearningCurve.of(points[:24], fields[:24]).gain(24)
        expected.append(gain.decibels)
        inside += gain.low <= happened[-1] <= gain.high
    assert np.mean(happened) > 3.0
    assert np.mean(expected) == pytest.approx(np.mean(happened), rel=0.35)
    assert inside >= 3


@pytest.mark.slow
def test_noise_gains_nothing() -> None:
    random = np.random.default_rng(0)
    curve = LearningCurve.of(random.uniform(-1.0, 1.0, (30, 2)), random.normal(size=(30, 4, 4, 4)))
    gain = curve.gain(30)
    assert abs(gain.decibels) < 1.0
    assert gain.low < gain.decibels < gain.high


@pytest.mark.slow
def test_it_is_the_same_each_time_and_says_what_it_is() -> None:
    points, fields = _ensemble(9, 0)
    first, again = LearningCurve.of(points, fields), LearningCurve.of(points, fields)
    np.testing.assert_array_equal(first.decibels, again.decibels)
    assert first.to_json()["members"] == 9
    assert len(first.to_json()["decibels"]) == len(first.sizes)
    assert str(first.gain(5)).startswith("5 more members: about +")
    assert (np.isfinite(first.decibels).sum(1) == 9 - first.sizes).all()


@pytest.mark.slow
@pytest.mark.parametrize("holes", [0, 40])
def test_holes_and_constant_fields_are_taken(holes: int) -> None:
    points, fields = _ensemble(10, 1)
    fields.reshape(10, -1)[:, :holes] = np.nan
    assert np.isfinite(LearningCurve.of(points, fields).line).all()
    constant = np.where(np.isnan(fields), np.nan, np.float32(2.0))
    assert np.isfinite(LearningCurve.of(points, constant).line).all()


@pytest.mark.slow
def test_members_of_a_run_are_left_out_together() -> None:
    points, fields = _ensemble(12, 0)
    runs = np.repeat([7, 2, 5, 9, 1, 4], 2)
    curve = LearningCurve.of(points, fields, runs=runs)
    is_out = np.isfinite(curve.decibels)
    np.testing.assert_array_equal(is_out[:, 0::2], is_out[:, 1::2])
    np.testing.assert_array_equal(is_out.sum(1), 12 - curve.sizes)
    with pytest.raises(TooFew, match="takes 8 runs or more, got 1"):
        LearningCurve.of(points, fields, runs=np.zeros(12, int))


def test_few_members_and_no_more_of_them_are_refused() -> None:
    points, fields = _ensemble(FEWEST_MEASURED, 0)
    with pytest.raises(TooFew, match=f"takes {FEWEST_MEASURED} members or more, got 7"):
        LearningCurve.of(points[:-1], fields[:-1])
    with pytest.raises(ValueError, match="more must be 1 member or more, got 0"):
        LearningCurve.of(points, fields).gain(0)
