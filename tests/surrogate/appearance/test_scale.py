"""The scale of carried values: even between knots, without ends, and its own inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.appearance.scale import AT_ONCE, ValueScale

GAPS = st.lists(st.floats(0.01, 100.0), min_size=1, max_size=11)
KNOTS = st.tuples(st.floats(-1e4, 1e4), GAPS).map(lambda drawn: np.cumsum([drawn[0], *drawn[1]]))


@given(KNOTS, st.floats(-3.0, 4.0))
def test_places_and_values_are_inverse(knots: NDArray[np.float64], place: float) -> None:
    scale = ValueScale(knots)
    assert scale.places(scale.values(place)) == pytest.approx(place, abs=1e-6)


@given(KNOTS)
def test_of_many_places_each_has_its_own_value(knots: NDArray[np.float64]) -> None:
    scale = ValueScale(knots)
    places = np.linspace(-0.5, 1.5, 2 * (AT_ONCE + 3), dtype=np.float32).reshape(2, -1)
    low = np.clip(np.floor(places.astype(np.float64) * (len(knots) - 1)).astype(np.int64), 0, len(knots) - 2)
    share = places.astype(np.float64) * (len(knots) - 1) - low
    np.testing.assert_allclose(
        scale.values(places), knots[low] * (1.0 - share) + knots[low + 1] * share, rtol=1e-9, atol=1e-9
    )


def test_a_place_that_is_no_number_has_no_value() -> None:
    np.testing.assert_array_equal(ValueScale(np.array([0.0, 1.0, 3.0])).values([np.nan, 1.0]), [np.nan, 3.0])


def test_knots_lie_evenly_and_the_ends_go_on() -> None:
    scale = ValueScale(np.array([-30.0, 0.0, 1.0, 80.0]))
    np.testing.assert_allclose(scale.places([-30.0, 0.0, 1.0, 80.0]), [0.0, 1 / 3, 2 / 3, 1.0])
    np.testing.assert_allclose(scale.places([-15.0, 0.5, 40.5]), [1 / 6, 0.5, 5 / 6])
    np.testing.assert_allclose(scale.places([-60.0, 159.0]), [-1 / 3, 4 / 3])


def test_its_knots_are_the_control_points_of_a_function() -> None:
    colors, opacities = ((0.0, 0, 0, 0), (2.0, 1, 1, 1)), ((-1.0, 0.0), (0.0, 0.5), (0.0 + 1e-9, 0.6), (3.0, 0.2))
    scale = ValueScale.of_function(TransferFunction(colors, opacities, 1.0))
    np.testing.assert_array_equal(scale.knots, [-1.0, 0.0, 2.0, 3.0])  # two that nearly coincide are one
    np.testing.assert_array_equal(ValueScale.from_json(scale.to_json()).knots, scale.knots)


@pytest.mark.parametrize("knots", [[], [1.0], [1.0, 1.0], [2.0, 1.0], [0.0, np.inf], [0.0, np.nan], [[0.0, 1.0]]])
def test_what_is_no_scale_is_refused(knots: list[float]) -> None:
    with pytest.raises(ValueError, match="knots of a scale of values must be at least two increasing numbers"):
        ValueScale(np.array(knots))
