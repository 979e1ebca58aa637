"""Summaries of times are the order statistics that they say."""

from __future__ import annotations

import time

from hypothesis import given
from hypothesis import strategies as st

from research.benchmarks.timing import MeasuredTime, digits, measured, measured_in_turn


@given(st.lists(st.floats(0.001, 1e6), min_size=1, max_size=30))
def test_summary_against_sorting(times: list[float]) -> None:
    ordered = sorted(times)
    middle = (ordered[(len(times) - 1) // 2] + ordered[len(times) // 2]) / 2
    assert MeasuredTime.of(times) == (middle, ordered[0], ordered[-1])


def test_digits() -> None:
    assert [digits(x) for x in (0.01234, 1.234, 12.34, 1234.5)] == ["0.012", "1.23", "12.3", "1,234"]
    assert str(MeasuredTime(1.234, 1.0, 20.0)) == "1.23 (1.00 to 20.0)"


def test_measured_counts_the_calls_it_takes() -> None:
    calls: list[None] = []
    measured(lambda: calls.append(None), 0.0, least=4)
    assert len(calls) == 1 + 4
    calls.clear()
    measured(lambda: calls.append(None), 10.0, most=7)
    assert len(calls) == 1 + 7


def test_measured_in_turn_keeps_the_order_and_sums_each_round() -> None:
    order: list[str] = []
    first, second, both = measured_in_turn([lambda: order.append("a"), lambda: time.sleep(0.002)], 0.0, least=3)
    assert order == ["a"] * 4
    assert second.lowest >= 2.0
    assert both.lowest >= first.lowest + second.lowest
    assert both.highest <= first.highest + second.highest + 1e-9
