"""Coordinates that were printed with few digits are taken for what they were."""

from __future__ import annotations

from decimal import ROUND_HALF_EVEN, Context, Decimal
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from insitu.readers.printed_axis import PrintedAxis, joined_axis

SPACINGS = st.floats(1e-6, 1e6)


def words(values: np.ndarray, digits: int) -> list[str]:
    """Values rounded to a number of significant digits, by decimal arithmetic."""
    rounded = Context(prec=digits, rounding=ROUND_HALF_EVEN)
    return [str(rounded.create_decimal_from_float(float(value))) for value in values]  # zeros at the end are left out


@given(SPACINGS, st.integers(-5, 5), st.integers(2, 200), st.integers(4, 9))
def test_even_coordinates_are_recognized_whatever_their_digits(
    step: float, start: int, count: int, digits: int
) -> None:
    true = (start + np.arange(count)) * step
    told = words(true, digits)
    if len(set(told)) < count:
        return  # so few digits that neighbours look alike
    axis = PrintedAxis.of(told)
    assert axis.step is not None
    assert abs(axis.step - step) <= (axis.rounding[0] + axis.rounding[-1]) / (count - 1) * (1 + 1e-6)


@given(st.integers(3, 50), st.data())
def test_one_coordinate_that_lies_elsewhere_is_seen(count: int, data: st.DataObject) -> None:
    told = words(1.0 + np.arange(count) / 7, 6)
    place = data.draw(st.integers(0, count - 1))
    if 0 < place < count - 1 or count > 3:
        told[place] = str(Decimal(told[place]) + Decimal("0.05"))
        assert PrintedAxis.of(told).step is None


@pytest.mark.parametrize("form", ["{:.4f}", "{:.3e}", "{:.5g}"])
@pytest.mark.parametrize("factor", [1.0, 1.002])
def test_every_way_to_print_is_understood(form: str, factor: float) -> None:
    true = np.arange(90) / 7.0
    true[45] *= factor
    step = PrintedAxis.of([form.format(value) for value in true]).step
    assert step == pytest.approx(1 / 7, rel=5e-4) if factor == 1 else step is None


@given(st.lists(st.integers(1, 60), min_size=1, max_size=5), SPACINGS, st.randoms())
@example([1, 1, 1], 1e-6, Random(0))
def test_pieces_make_the_whole_in_any_order(sizes: list[int], step: float, random: object) -> None:
    ends = np.cumsum([0, *sizes])
    words = [f"{value:.6e}" for value in np.arange(ends[-1] + 1) * step]  # all digits: repr would print 1e-06 with one
    pieces = [PrintedAxis.of(words[a : b + 1]) for a, b in pairwise(ends)]
    order = [*range(len(pieces)), *range(len(pieces))]  # each twice, as by ranks beside each other
    random.shuffle(order)  # type: ignore[attr-defined]
    axis, begins = joined_axis([pieces[i] for i in order])
    assert axis.values.tolist() == list(map(float, words))
    assert begins == [int(ends[i]) for i in order]


@pytest.mark.parametrize(
    ("spans", "message"),
    [
        ([(0, 2), (3, 5)], "leave a gap between 2 and 3"),
        ([(0, 3), (2, 5)], "overlap between 3 and 2"),
        ([(0, 3), (0, 5)], "overlap"),
    ],
)
def test_pieces_that_do_not_meet_are_refused(spans: list[tuple[int, int]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        joined_axis([PrintedAxis.of([f"{v}.0" for v in range(a, b + 1)]) for a, b in spans])


@pytest.mark.parametrize(
    "told",
    [
        ["1"],
        ["1", "1"],
        ["2", "1"],
        ["a", "b"],
        ["nan", "1"],
        ["1", "inf"],
        ["1", "1e999"],
        ["0", "1e-9999"],
        ["", "1"],
    ],
)
def test_what_is_no_axis_is_refused(told: list[str]) -> None:
    with pytest.raises(ValueError, match="coordinates must"):
        PrintedAxis.of(told)
