"""The functions that are asked for are those that are described, and any scene has some."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.appearance import TransferFunction
from research.benchmarks.training.functions.departures import KNOWN_MARKS, PEAK, Marks, departures, places
from surrogate.evaluation.novelty import SeenValues

# Those of scenes/cloverleaf.toml, rounded.
VALUES = (0.8, 0.87, 1.0, 1.13, 1.39, 2.18, 4.0, 5.2, 7.4, 8.1, 8.7, 9.2)
OPACITIES = (0.17, 0.17, 0.04, 0.0, 0.03, 0.0, 0.34, 0.51, 0.72, 0.76, 0.74, 0.8)
COLORS = ((0.8, 0.2, 0.3, 0.7), (9.2, 0.7, 0.1, 0.2))
BASE = TransferFunction(COLORS, tuple(zip(VALUES, OPACITIES, strict=True)), 0.25)
FOUR_POINTS = TransferFunction(COLORS, ((0.8, 0.0), (2.0, 0.1), (6.0, 0.5), (9.2, 1.0)), 0.25)


def test_the_functions_of_cloverleaf_are_those_that_the_goals_name() -> None:
    found = departures(BASE, KNOWN_MARKS["cloverleaf"])
    expected = {
        "half": [a / 2 for a in OPACITIES],
        "double": [min(0.95, 1 - (1 - a) ** 2) for a in OPACITIES],
        "ramp": [0.6 * (v - 0.8) / 8.4 for v in VALUES],
        "high": [0] * 7 + list(OPACITIES[7:]),
        "low": [0.5] * 4 + [0.2] + [0] * 7,
        "middle": [0.6 * np.exp(-((v - 3) ** 2)) for v in VALUES],
        "colours": list(OPACITIES),
    }
    assert list(found) == [*expected, PEAK]
    for name, opacities in expected.items():
        assert [value for value, _ in found[name].opacity_points] == list(VALUES)
        np.testing.assert_allclose([opacity for _, opacity in found[name].opacity_points], opacities, atol=1e-12)
        assert found[name].opacity_unit_distance == 0.25
        assert name == "colours" or found[name].color_points == COLORS
    assert found["colours"].color_points == ((0.8, 0.7, 0.2, 0.3), (9.2, 0.2, 0.7, 0.1))  # (r, g, b) -> (b, r, g)
    peak = found[PEAK].opacities([2.9, 2.95, 3.0, 3.05, 3.1])
    assert (peak[[0, 4]] == 0).all()
    assert peak[2] == 0.8


def test_a_function_of_few_points_is_changed_at_more_and_stays_itself_between() -> None:
    at = places(FOUR_POINTS)
    assert len(at) >= 16
    assert {0.8, 2.0, 6.0, 9.2} <= set(at)
    half = departures(FOUR_POINTS, Marks(1.0, 2.0, 4.0, 7.0))["half"]
    values = np.linspace(0.0, 10.0, 101)
    np.testing.assert_allclose(half.opacities(values), FOUR_POINTS.opacities(values) / 2, atol=1e-12)


def test_marks_stand_where_the_same_shares_are_visible_as_in_cloverleaf() -> None:
    even = TransferFunction(((0.0, 1, 1, 1), (100.0, 1, 1, 1)), ((0.0, 0.5), (100.0, 0.5)), 1.0)
    edges = np.linspace(0.0, 100.0, 51)
    seen = SeenValues(edges, np.full(50, 0.02), np.ones(50))
    marks = Marks.of(seen, even)
    assert (marks.low, marks.lower, marks.middle, marks.high) == pytest.approx((14.0, 36.0, 66.0, 97.0))
    assert KNOWN_MARKS["cloverleaf"].width == 1.0
    clear = TransferFunction(COLORS, ((0.0, 0.0), (1.0, 0.0)), 1.0)
    with pytest.raises(ValueError, match="shows nothing of these members"):
        Marks.of(seen, clear)
