"""Numbers of emulated fields agree with those of a fine calculation, and their errors with many drawn fields."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from surrogate.emulation import EmulatedField, FieldEmulator, measures
from tests.support.ensembles_of_fields import ORIGIN, SHAPE, SPACING, places, smooth, some_points

POINT = np.array([0.1, -0.3])
BOX = ((0.0, 2.5, 3.2), (3.0, 4.0, 5.0))


def predicted(count: int = 8) -> EmulatedField:
    points = some_points(count)
    return FieldEmulator.fit(points, smooth(points), SPACING, ORIGIN).at(POINT)


def known(values: np.ndarray, holes: np.ndarray | None = None) -> EmulatedField:
    return EmulatedField(values.astype(np.float32), holes, SPACING, ORIGIN)


def ramp() -> EmulatedField:
    """A field that is linear in x, y and z."""
    return known(places() @ np.array([1.0, 2.0, 3.0]))


def test_linear_fields_are_interpolated_exactly() -> None:
    random = np.random.default_rng(0)
    low, high = places().reshape(-1, 3).min(0), places().reshape(-1, 3).max(0)
    points = low + random.random((50, 3)) * (high - low)
    found = measures.sample(ramp(), points)
    np.testing.assert_allclose(found.values, points @ [1.0, 2.0, 3.0], rtol=1e-6)
    assert found.deviations is None


def test_profiles_and_planes_are_samples() -> None:
    line = measures.profile(ramp(), (-1.0, 2.0, 3.0), (4.5, 4.25, 3.875), 5)
    np.testing.assert_allclose(np.diff(line.values), np.full(4, (5.5 + 4.5 + 2.625) / 4), rtol=1e-5)
    for axis, index in (("x", 0), ("y", 1), ("z", 2)):
        at = ORIGIN[index] + 2.5 * SPACING[index]
        plane = measures.plane(ramp(), axis, at)
        assert plane.values.shape == tuple(np.delete(SHAPE, 2 - index))
        np.testing.assert_allclose(plane.values, plane.places @ [1.0, 2.0, 3.0], rtol=1e-5)
        np.testing.assert_allclose(plane.places[..., index], at)
    emulated = measures.plane(predicted(), "z", ORIGIN[2])
    np.testing.assert_allclose(emulated.values, predicted().values[0], rtol=1e-5)
    assert emulated.deviations is not None
    assert emulated.deviations.shape == emulated.values.shape


def test_statistics_are_those_of_the_samples_in_the_box() -> None:
    field = ramp()
    inside = ((places() >= BOX[0]) & (places() <= BOX[1])).all(-1)
    values = field.values[inside]
    found = measures.statistics(field, BOX, level=17.0)
    numbers = (found.minimum, found.maximum, found.mean, found.share_above)
    expected = (values.min(), values.max(), values.mean(), (values > 17.0).mean())
    np.testing.assert_allclose([n.value for n in numbers if n], expected, rtol=1e-6)
    assert {n.deviation for n in numbers if n} == {None}
    assert measures.statistics(field).share_above is None


def test_holes_are_left_out() -> None:
    field = ramp()
    holes = field.values > 20.0
    found = measures.statistics(replace(field, holes=holes))
    assert found.maximum.value <= 20.0
    samples = measures.sample(replace(field, holes=holes), places().reshape(-1, 3))
    np.testing.assert_array_equal(np.isnan(samples.values), holes.ravel())


def test_histograms_are_shares() -> None:
    edges = np.linspace(0.0, 40.0, 9)
    found = measures.histogram(predicted(), edges)
    expected = np.histogram(predicted().values, edges)[0] / predicted().values.size
    np.testing.assert_allclose(found.shares, expected)
    assert found.deviations is not None
    assert found.shares.sum() == pytest.approx(1.0)


def test_errors_are_those_of_drawn_fields_and_repeat() -> None:
    field = predicted()
    assert field.posterior is not None
    first, again = measures.statistics(field, level=10.0), measures.statistics(field, level=10.0)
    assert first == again
    many = measures.statistics(field, level=10.0, draws=2_000, seed=1)
    assert first.mean.deviation == pytest.approx(many.mean.deviation, rel=0.3)
    exact = np.sqrt(field.posterior.spreads**2 @ field.posterior.modes.mean(1, dtype=np.float64) ** 2)
    assert many.mean.deviation == pytest.approx(exact * field.posterior.factors["mean"], rel=0.06)
    assert str(first.mean).count("±") == 1


@pytest.mark.parametrize(
    ("measure", "complaint"),
    [
        (lambda f: measures.sample(f, [[0.0, 1.0]]), "places must be N finite points"),
        (lambda f: measures.sample(f, [[0.0, 1.0, np.nan]]), "places must be N finite points"),
        (lambda f: measures.profile(f, (0, 0), (1, 1, 1)), "end of a profile must be 3 numbers"),
        (lambda f: measures.profile(f, (0, 0, 0), (1, 1, 1), 0), "number of places"),
        (lambda f: measures.plane(f, "w", 0.0), "axis must be one of x, y, z, got 'w'"),
        (lambda f: measures.plane(f, "x", 99.0), "reaches from x = -1 to 4.5, got the coordinate 99"),
        (lambda f: measures.statistics(f, ((50, 50, 50), (60, 60, 60))), "no sample with a value lies in the box"),
        (lambda f: measures.statistics(f, level=np.nan), "level must be a finite number"),
        (lambda f: measures.histogram(f, [1.0, 1.0]), "increasing numbers"),
    ],
)
def test_what_can_not_be_measured_is_named(measure: Callable[[EmulatedField], object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        measure(ramp())
