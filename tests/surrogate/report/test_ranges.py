"""Ranges of parameters that hold some members."""

from __future__ import annotations

import pytest

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.report.ranges import short_between, where

SPACE = ParameterSpace((Parameter("Re", 0.0, 1000.0), Parameter("time", 0.0, 10.0, "s")))
GRID = [{"Re": 100.0 * i, "time": float(j)} for i in range(1, 10) for j in range(1, 10)]
ROW = [{"Re": 500.0, "time": float(j)} for j in range(12)]


@pytest.mark.parametrize(
    ("members", "is_meant", "found"),
    [
        (ROW, lambda m: m["time"] > 8, "time > 8.5 s"),
        (ROW, lambda m: m["time"] < 3, "time < 2.5 s"),
        (ROW, lambda m: m["time"] == 11, ""),  # the last of twelve by chance
        (ROW, lambda m: m["time"] in (2, 6, 9), ""),
        (ROW, lambda _: True, ""),
        (ROW, lambda _: False, ""),
        (ROW[:3], lambda m: m["time"] > 0, ""),  # two of three lie at one end by chance
        (GRID, lambda m: m["Re"] < 350 and m["time"] > 7, "Re < 350 time > 7.5 s"),
        (GRID, lambda m: m["Re"] < 350, "Re < 350"),
        (GRID, lambda m: (m["Re"] + 100 * m["time"]) % 300 == 0, ""),
        ([], lambda _: True, ""),
    ],
)
def test_a_range_holds_the_members_that_chance_would_not_put_there(members, is_meant, found: str) -> None:
    bounds = where(SPACE, members, [bool(is_meant(m)) for m in members])
    assert " ".join(map(str, bounds)) == found
    assert all(all(b.holds(m) for b in bounds) for m in members if bounds and is_meant(m))


def test_no_parameters_have_no_range() -> None:
    assert where(ParameterSpace(()), [{}, {}], [True, False]) == ()


@pytest.mark.parametrize(
    ("one", "other", "found"), [(7.0, 9.6, 8.0), (1.001, 1.002, 1.0015), (-3.0, 5.0, 1.0), (1e-7, 3e-7, 2e-7)]
)
def test_a_number_between_two_has_few_digits(one: float, other: float, found: float) -> None:
    assert short_between(one, other) == short_between(other, one) == pytest.approx(found, rel=1e-12)
    assert min(one, other) < short_between(one, other) < max(one, other)
