"""Intervals of a box's numbers hold at parameters of no member, as those of left-out members promise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surrogate.appearance.scale import ValueScale
from surrogate.emulation import EmulatedField, FieldEmulator
from surrogate.emulation.measures import NUMBERS, Measured, statistics
from tests.support.ensembles_of_fields import ORIGIN, SPACING, smooth, some_points

SIDE, UNSEEN = 10, 60
SLOW = pytest.mark.slow
NORMAL = 1.6448536269514722
LEVEL = 1.0
SCALE = ValueScale(np.array([0.5, 1.0, 1.2, 2.0]))


def rough(points: np.ndarray) -> np.ndarray:
    """Fields (M, 10, 10, 10) with a front that moves, of which a few members know little."""
    z, y, x = np.meshgrid(*[np.linspace(-1.0, 1.0, SIDE)] * 3, indexing="ij")
    p, q = (column[:, None, None, None] for column in points.T)
    front = np.tanh(4.0 * (x - 0.5 * p + 0.3 * np.sin(2.0 * y + q)))
    return np.asarray(1.0 + 0.4 * front + 0.2 * q * z * y, dtype=np.float32)


def emulator(count: int, seed: int, scale: ValueScale | None = None) -> FieldEmulator:
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2))
    return FieldEmulator.fit(points, rough(points), (1.0,) * 3, (0.0,) * 3, scale)


def inside(count: int, scale: ValueScale | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The shares (4,) of unseen numbers in their 90 % intervals, and in those of the drawn fields alone."""
    calibrated, drawn = [], []
    for seed in range(3):
        fitted = emulator(count, seed, scale)
        factors = np.array([fitted.number_factors[name] for name in NUMBERS])
        for point in np.random.default_rng(100 + seed).uniform(-1.0, 1.0, (UNSEEN, 2)):
            field = fitted.at(point)
            truth = EmulatedField(rough(point[None])[0], None, field.spacing, field.origin)
            ours, true = (statistics(f, level=LEVEL) for f in (field, truth))
            pairs: list[tuple[Measured, Measured]] = [(getattr(ours, n), getattr(true, n)) for n in NUMBERS]
            off = np.array([abs(a.value - b.value) for a, b in pairs])
            deviations = np.array([a.deviation for a, _ in pairs])
            calibrated.append(off <= NORMAL * deviations)
            drawn.append(off <= NORMAL * deviations / factors)
    return np.mean(calibrated, 0), np.mean(drawn, 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "scale"),
    [(10, None), pytest.param(20, None, marks=SLOW), pytest.param(40, None, marks=SLOW), (20, SCALE)],
)
def test_intervals_of_numbers_hold(count: int, scale: ValueScale | None) -> None:
    calibrated, drawn = inside(count, scale)
    assert (calibrated >= 0.85).all(), calibrated
    assert calibrated.min() > drawn.min()


@pytest.mark.parametrize("count", [3, 8, 9])
def test_few_members_have_factors(count: int) -> None:
    """Of eight no quantile of nine tenths exists, so that the greatest ratio counts, as it does of nine."""
    assert all(0.0 < factor < np.inf for factor in emulator(count, 0).number_factors.values())


def test_a_constant_field_has_certain_numbers() -> None:
    points = some_points(6)
    fitted = FieldEmulator.fit(points, np.full((6, 3, 4, 5), 2.0, np.float32), SPACING, ORIGIN)
    assert set(fitted.number_factors.values()) == {1.0}
    found = statistics(fitted.at(points[0]), level=1.0)
    assert [getattr(found, name).deviation for name in NUMBERS] == [0.0] * 4


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 5), (2, 1, 3), (1, 9, 9)])
def test_thin_fields_have_parts(shape: tuple[int, int, int]) -> None:
    points = some_points(8)
    fields = np.random.default_rng(0).normal(size=(8, *shape)).astype(np.float32) + points[:, :1, None, None]
    fitted = FieldEmulator.fit(points, fields, SPACING, ORIGIN)
    assert all(0.0 < factor < np.inf for factor in fitted.number_factors.values())


def test_factors_are_stored_passed_on_and_lacking_in_older_emulators(tmp_path: Path) -> None:
    points = some_points(12)
    fitted = FieldEmulator.fit(points, smooth(points), SPACING, ORIGIN)
    fitted.save(tmp_path)
    assert FieldEmulator.load(tmp_path).number_factors == fitted.number_factors
    older = replace(fitted, number_factors={})
    field, before = (one.at(points[0] * 0.9) for one in (fitted, older))
    for one, other in ((field, before), (field.resampled(field.values.shape), before.resampled(field.values.shape))):
        ours, plain = statistics(one, level=LEVEL), statistics(other, level=LEVEL)
        for name, factor in fitted.number_factors.items():
            assert getattr(ours, name).value == getattr(plain, name).value
            assert getattr(ours, name).deviation == pytest.approx(factor * getattr(plain, name).deviation)
    edges = np.linspace(0.0, 2.0, 5)
    share = fitted.number_factors["share_above"]
    np.testing.assert_allclose(field.histogram(edges).deviations, share * before.histogram(edges).deviations)
