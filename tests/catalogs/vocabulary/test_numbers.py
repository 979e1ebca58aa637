"""Numbers from people and files: what is one, and that what is none is named."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary import numbers


@pytest.mark.parametrize(
    "value", [2, 2.0, np.float32(2), np.float64(2), np.int16(2), np.uint8(2), np.array(2.0), Fraction(4, 2)], ids=repr
)
def test_every_kind_of_number_becomes_a_plain_float(value: Any) -> None:
    found = numbers.finite(value, "x")
    assert type(found) is float
    assert found == 2.0


@pytest.mark.parametrize(
    "value",
    [
        "2",
        b"2",
        True,
        np.True_,
        None,
        1j,
        np.complex64(1),
        [2.0],
        np.array([2.0]),
        float("nan"),
        np.inf,
        10**400,
        object(),
        "x" * 10**6,
    ],
    ids=lambda value: f"{type(value).__name__}",
)
def test_what_is_no_finite_number_is_named_in_one_short_sentence(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^x must be a finite number, got ") as caught:
        numbers.finite(value, "x")
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("check", "value", "message"),
    [
        (numbers.positive, 0, "x must be positive, got 0"),
        (numbers.fraction, 1.5, r"x must lie in \[0, 1\], got 1.5"),
        (numbers.count, 0, "x must be a whole number, at least 1, got 0"),
        (numbers.count, 2.5, "x must be a whole number, at least 1, got 2.5"),
    ],
)
def test_numbers_out_of_range_are_named(check: Callable[[Any, str], float], value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check(value, "x")


def test_counts_are_integers() -> None:
    assert type(numbers.count(np.int64(3), "x")) is int


@pytest.mark.parametrize("values", ["abc", (1, 2), 3, (1, 2, "red"), np.zeros((3, 1)), {"a": 1}], ids=repr)
def test_a_row_is_that_many_numbers(values: Any) -> None:
    with pytest.raises(ValueError, match=r"^x must be"):
        numbers.row(values, 3, "x")
    assert numbers.row(np.arange(3), 3, "x") == (0.0, 1.0, 2.0)
