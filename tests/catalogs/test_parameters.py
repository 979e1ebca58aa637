"""Parameter spaces: names, bounds, and where members are placed."""

from __future__ import annotations

import inspect
import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.parameters import Parameter, ParameterSpace

SPACE = ParameterSpace((Parameter("Re", 100.0, 200.0), Parameter("Ma", -1.0, 3.0, "m/s")))


@given(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)))
def test_normalizing_is_undone(values: tuple[float, float]) -> None:
    assert SPACE.denormalize(SPACE.normalize(values)) == pytest.approx(values, abs=1e-9)


def test_bounds_are_plus_and_minus_one() -> None:
    assert SPACE.normalize([[100.0, -1.0], [200.0, 3.0], [150.0, 1.0]]).tolist() == [[-1, -1], [1, 1], [0, 0]]


@given(count=st.integers(1, 40), seed=st.integers(0, 100))
def test_a_latin_hypercube_has_one_member_in_every_slice(count: int, seed: int) -> None:
    members = SPACE.latin_hypercube(count, seed)
    slices = np.floor((SPACE.normalize(members) + 1.0) / 2.0 * count).astype(int)
    assert all(sorted(column) == list(range(count)) for column in slices.T)
    assert np.array_equal(members, SPACE.latin_hypercube(count, seed))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"Re": 150.0}, "missing"),
        ({"Re": 150.0, "Ma": 0.0, "x": 1.0}, "unknown"),
        ({"Re": float("inf"), "Ma": 0.0}, "Re"),
        ({"Re": "fast", "Ma": 0.0}, "parameter Re must be a number, got 'fast'"),
        ({"Re": 150.0, "Ma": None}, "parameter Ma must be a number, got None"),
    ],
)
def test_wrong_parameters_are_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SPACE.values(values)


def test_out_of_bounds_only_warns() -> None:
    with pytest.warns(UserWarning, match=r"Re = 250 .* \[100, 200\]"):
        assert SPACE.values({"Ma": 0.0, "Re": 250.0}).tolist() == [250.0, 0.0]


def test_what_is_allowed_outside_brings_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert SPACE.values({"Ma": 0.0, "Re": 250.0}, outside="allow").tolist() == [250.0, 0.0]


def test_other_ways_to_treat_what_is_outside_are_refused() -> None:
    with pytest.raises(ValueError, match="outside must be"):
        SPACE.values({"Ma": 0.0, "Re": 150.0}, outside="ignore")  # type: ignore[arg-type]


def test_a_warning_names_the_line_of_the_caller() -> None:
    with pytest.warns(UserWarning, match="Re") as caught:
        SPACE.values({"Ma": 0.0, "Re": 250.0})
    line = inspect.currentframe().f_lineno - 1  # type: ignore[union-attr]
    assert [(w.filename, w.lineno) for w in caught] == [(__file__, line)]


def test_each_parameter_outside_is_named_and_rounding_is_forgiven() -> None:
    assert list(SPACE.outside([99.0, 3.5])) == ["Re", "Ma"]
    assert SPACE.outside([100.0 - 1e-9, 3.0 + 1e-12]) == {}


def test_json_round_trip() -> None:
    assert ParameterSpace.from_json(SPACE.to_json()) == SPACE


@pytest.mark.parametrize(("name", "low", "high"), [("", 0, 1), ("a", 1, 1), ("a", 2, 1), ("a", 0, float("nan"))])
def test_impossible_parameters_are_refused(name: str, low: float, high: float) -> None:
    with pytest.raises(ValueError, match="bounds"):
        Parameter(name, low, high)


def test_names_are_unique() -> None:
    with pytest.raises(ValueError, match="unique"):
        ParameterSpace((Parameter("a", 0, 1), Parameter("a", 0, 2)))
