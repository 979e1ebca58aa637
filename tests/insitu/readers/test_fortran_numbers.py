"""Numbers with the exponents that Fortran prints."""

from __future__ import annotations

import pytest

from insitu.readers.fortran_numbers import printed_number, respelled
from insitu.readers.printed_axis import PrintedAxis


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("0.1584-100", 0.1584e-100),
        ("-0.1584+100", -0.1584e100),
        ("1.5+101", 1.5e101),
        (" .5-300 ", 0.5e-300),
        ("1.-100", 1e-100),
        ("1.5D+00", 1.5),
        ("-2.5d3", -2500.0),
        ("0.15E-07", 0.15e-7),
        ("12", 12.0),
        ("-3.25", -3.25),
        ("1e5", 1e5),
    ],
)
def test_a_word_is_its_number(word: str, value: float) -> None:
    assert printed_number(word) == value


@pytest.mark.parametrize("word", ["100-200", "2020-100", "1.5-10", "1.5-1000", "1.5D", "D+00", "1.5-100.5", "2D3", ""])
def test_other_words_are_no_numbers(word: str) -> None:
    with pytest.raises(ValueError, match="could not convert"):
        printed_number(word)


def test_a_line_has_each_of_its_numbers() -> None:
    line = respelled(b" 0.1584-100-0.5+101 1.5E-007 1.5D+00 2.-300\n")
    assert line == b" 0.1584E-100-0.5E+101 1.5E-007 1.5E+00 2.E-300\n"


def test_an_axis_of_tiny_coordinates_is_even_as_far_as_its_digits_say() -> None:
    axis = PrintedAxis.of(["0.0000E+00", "0.3333-099", "0.6667-099", "0.1000-098"])
    assert axis.step == pytest.approx(1e-99 / 3, rel=3e-4)
