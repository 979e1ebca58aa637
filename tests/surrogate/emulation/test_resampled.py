"""Fields on other numbers of samples are what trilinear interpolation gives at these places, with its deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surrogate.appearance.scale import ValueScale
from surrogate.emulation import EmulatedField, FieldEmulator
from surrogate.emulation.posterior import Posterior
from tests.support.ensembles_of_fields import ORIGIN, SHAPE, SPACING, smooth, some_points

POINT = np.array([0.1, -0.3])
SCALE = ValueScale(np.array([0.0, 9.0, 10.5, 40.0]))


def predicted(scale: ValueScale | None = None) -> EmulatedField:
    points = some_points(8)
    field = FieldEmulator.fit(points, smooth(points), SPACING, ORIGIN).at(POINT)
    if scale is None:
        return field
    assert isinstance(field.posterior, Posterior)
    unit = np.float32(0.1)  # of the scale, a tenth of the values
    scaled = {name: unit * getattr(field.posterior, name) for name in ("mean", "modes", "residual")}
    posterior = replace(field.posterior, scale=scale, **scaled)
    return replace(field, values=posterior.values().reshape(SHAPE), posterior=posterior)


def places_of(field: EmulatedField) -> np.ndarray:
    k, j, i = np.meshgrid(*map(np.arange, field.values.shape), indexing="ij")
    return (np.stack([i, j, k], -1) * np.array(field.spacing) + np.array(field.origin)).reshape(-1, 3)


@pytest.mark.parametrize("shape", [(8, 10, 12), (15, 19, 23), (5, 4, 3), (2, 2, 2), (17, 10, 7)])
def test_they_are_samples_of_the_field(shape: tuple[int, int, int]) -> None:
    field = predicted()
    other = field.resampled(shape)
    assert other.values.shape == shape
    assert other.values.dtype == np.float32
    last = np.array(field.spacing) * (np.array(SHAPE[::-1]) - 1)
    np.testing.assert_allclose(np.array(other.spacing) * (np.array(shape[::-1]) - 1), last)
    expected = field.sample(places_of(other))
    np.testing.assert_allclose(other.values.ravel(), expected.values, rtol=1e-6)
    np.testing.assert_allclose(other.deviations.ravel(), expected.deviations, rtol=1e-4)  # type: ignore[union-attr]
    again = other.sample(places_of(other)[:5])
    np.testing.assert_allclose(again.deviations, expected.deviations[:5], rtol=1e-4)  # type: ignore[index]
    if shape > SHAPE:
        assert other.statistics().mean.deviation == pytest.approx(field.statistics().mean.deviation, rel=0.3)


def test_deviations_on_a_scale_of_values_are_in_the_unit() -> None:
    field = predicted(SCALE)
    other = field.resampled((15, 19, 23))
    expected = field.sample(places_of(other))
    np.testing.assert_allclose(other.values.ravel(), expected.values, rtol=1e-6)
    np.testing.assert_allclose(other.deviations.ravel(), expected.deviations, rtol=1e-3)  # type: ignore[union-attr]


def test_beside_holes_there_are_holes() -> None:
    holes = np.zeros(SHAPE, bool)
    holes[3, 4, 5] = True
    field = replace(predicted(), holes=holes)
    np.testing.assert_array_equal(field.resampled(SHAPE).holes, holes)
    other = field.resampled((15, 19, 23))
    np.testing.assert_array_equal(other.holes.ravel(), np.isnan(field.sample(places_of(other)).values))  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("shape", "complaint"),
    [
        ((4, 4), "shape of a field, .z, y, x., must be 3 numbers"),
        (7, "shape of a field, .z, y, x., must be 3 numbers"),
        ((4, 4, 0), "must be a whole number, at least 1, got 0"),
        ((4, 2.5, 4), "must be a whole number"),
        ((4, 1, 4), "must have 2 samples or more along y, got 1"),
        ((4096, 4096, 4096), "at most 268,435,456 samples"),
    ],
)
def test_other_shapes_are_refused(shape: object, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        predicted().resampled(shape)  # type: ignore[arg-type]


def test_flat_fields_stay_flat() -> None:
    flat = EmulatedField(np.ones((1, 3, 4), np.float32), None, (1.0, 1.0, 2.0), (0.0, 0.0, 0.0))
    other = flat.resampled((1, 5, 2))
    assert (other.values.shape, other.spacing, other.deviations) == ((1, 5, 2), (3.0, 0.5, 2.0), None)
    with pytest.raises(ValueError, match="must have 1 sample, as the field has along z, got 2"):
        flat.resampled((2, 5, 2))
