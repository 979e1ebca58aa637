"""Parameter spaces: names, bounds, and where members are placed."""

from __future__ import annotations

import inspect
import json
import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.vocabulary.parameters import Parameter, ParameterSpace

MIXED = ParameterSpace((Parameter("nu", 1e-5, 1e-1, "m²/s", "log"), Parameter("Re", 100.0, 200.0)))
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
        ({"Re": 10**400, "Ma": 0.0}, "parameter Re must be finite, got 1000"),
        (
            {"Re": 150.0, "Ma": 2**60 + 1},
            "parameter Ma = 1152921504606846977 has more digits.*would become 1152921504606846976",
        ),
        ({"Re": np.int64(2**60 + 1), "Ma": 0.0}, "has more digits"),
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


def test_a_logarithmic_scale_makes_equal_ratios_equal_steps() -> None:
    decades = [1e-5, 1e-4, 1e-3, 1e-2, 1e-1]
    normalized = MIXED.normalize([(value, 150.0) for value in decades])
    assert normalized[:, 0] == pytest.approx([-1.0, -0.5, 0.0, 0.5, 1.0], abs=1e-12)
    assert normalized[:, 1].tolist() == [0.0] * 5
    assert normalized[[0, -1], 0].tolist() == [-1.0, 1.0]  # the bounds exactly
    assert MIXED.denormalize(normalized)[:, 0] == pytest.approx(decades, rel=1e-12)


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_denormalizing_on_a_logarithmic_scale_is_undone(first: float, second: float) -> None:
    assert MIXED.normalize(MIXED.denormalize((first, second))) == pytest.approx((first, second), abs=1e-9)


def test_the_linear_parameters_of_a_mixed_space_are_bitwise_those_of_a_linear_one() -> None:
    alone, values = ParameterSpace(MIXED.parameters[1:]), np.random.default_rng(0).uniform(90.0, 210.0, (50, 1))
    mixed = np.concatenate([np.full((50, 1), 1e-3), values], axis=1)
    assert np.array_equal(MIXED.normalize(mixed)[:, 1:], alone.normalize(values))


def test_a_latin_hypercube_has_equal_slices_on_a_logarithmic_scale() -> None:
    members = MIXED.latin_hypercube(8, seed=3)  # [8, 2]
    slices = np.floor(np.log10(members[:, 0] / 1e-5) / 4.0 * 8).astype(int)
    assert sorted(slices) == list(range(8))


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_what_is_not_positive_on_a_logarithmic_scale_is_refused(value: float) -> None:
    for refused in (lambda: MIXED.values({"nu": value, "Re": 150.0}), lambda: MIXED.normalize((value, 150.0))):
        with pytest.raises(ValueError, match="parameter nu has a logarithmic scale, so it must be positive, got"):
            refused()
    assert list(MIXED.outside((value, 150.0))) == ["nu"]


def test_outside_is_judged_on_the_scale() -> None:
    assert MIXED.outside([1e-5 * (1.0 - 1e-10), 150.0]) == {}
    assert "nu = 9e-06" in MIXED.outside([9e-6, 150.0])["nu"]


@pytest.mark.parametrize("parameter", [*MIXED.parameters, Parameter("T", -40.0, 60.0)])
def test_fractions_of_the_range_are_undone_and_half_of_it_is_the_middle(parameter: Parameter) -> None:
    for part in (0.0, 0.2, 0.5, 1.0, 1.3):
        assert parameter.fraction(parameter.at(part)) == pytest.approx(part, abs=1e-12)
    assert parameter.at(0.5) == pytest.approx(parameter.middle, rel=1e-12)
    assert (parameter.at(0.0), parameter.at(1.0)) == pytest.approx((parameter.low, parameter.high), rel=1e-12)


def test_widely_spaced_bounds_do_not_overflow() -> None:
    wide = Parameter("x", 1e-300, 1e300, scale="log")
    assert wide.middle == pytest.approx(1.0)
    assert wide.at(0.5) == pytest.approx(1.0, rel=1e-9)


def test_scales_and_units_are_said() -> None:
    assert str(MIXED) == "nu in [1e-05, 0.1] m²/s (log), Re in [100, 200]"
    assert [p.label for p in MIXED.parameters] == ["nu (m²/s)", "Re"]


def test_a_scale_is_written_only_where_it_is_logarithmic() -> None:
    assert ParameterSpace.from_json(json.loads(json.dumps(MIXED.to_json()))) == MIXED
    assert [record.get("scale") for record in MIXED.to_json()] == ["log", None]
    assert SPACE.to_json()[1] == {"name": "Ma", "low": -1.0, "high": 3.0, "unit": "m/s"}  # as before there were scales


def test_numpy_numbers_become_plain_ones() -> None:
    parameter = Parameter("a", np.float32(0.5), np.int64(2))  # type: ignore[arg-type]
    assert json.dumps(parameter.to_json()) == '{"name": "a", "low": 0.5, "high": 2.0, "unit": ""}'


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a", 0.0, 1.0, "", "log"), 'scale "log", so its bounds must be positive, got 0, 1'),
        (("a", 1.0, 2.0, "", "ln"), r"scale must be one of .*linear.*log.*, got 'ln'"),
        (("a", 1.0, 2.0, 5), "its unit must be text, got 5"),
        (("a", 1.0, 2.0, None), "its unit must be text, got None"),
        (("a", "low", 2.0), "parameter a: low, one of its bounds, must be a finite number, got 'low'"),
        (("a", True, 2.0), "low, one of its bounds, must be a finite number, got True"),
        ((5, 1.0, 2.0), "got the name 5"),
    ],
)
def test_each_thing_wrong_with_a_parameter_is_named(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Parameter(*arguments)


def test_wrong_keys_of_a_record_are_named() -> None:
    with pytest.raises(ValueError, match=r"parameter 'a': missing keys high, unknown keys hi; known are"):
        Parameter.from_json({"name": "a", "low": 0.0, "hi": 1.0})


@pytest.mark.parametrize(("name", "low", "high"), [("", 0, 1), ("a", 1, 1), ("a", 2, 1), ("a", 0, float("nan"))])
def test_impossible_parameters_are_refused(name: str, low: float, high: float) -> None:
    with pytest.raises(ValueError, match="bounds"):
        Parameter(name, low, high)


def test_names_are_unique() -> None:
    with pytest.raises(ValueError, match="unique"):
        ParameterSpace((Parameter("a", 0, 1), Parameter("a", 0, 2)))
