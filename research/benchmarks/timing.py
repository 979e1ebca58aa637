"""Time of a call: the median of several in one run, with the fastest and the slowest."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple


class MeasuredTime(NamedTuple):
    """Milliseconds (wall clock) of one call, over several: the median, the fastest, the slowest."""

    median: float
    lowest: float
    highest: float

    @classmethod
    def of(cls, milliseconds: Sequence[float]) -> MeasuredTime:
        """The summary of one or more measurements."""
        return cls(statistics.median(milliseconds), min(milliseconds), max(milliseconds))

    def __str__(self) -> str:
        return f"{digits(self.median)} ({digits(self.lowest)} to {digits(self.highest)})"


def digits(value: float) -> str:
    """`value` with three digits, and never an exponent."""
    size = abs(value)
    decimals = 0 if size >= 100 else 1 if size >= 10 else 2 if size >= 1 else 3
    return f"{value:,.{decimals}f}"


def timed(call: Callable[[], object]) -> float:
    """Milliseconds (wall clock) of one call."""
    started = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - started)


def processor_seconds(call: Callable[[], object]) -> float:
    """Seconds of processor time of one call."""
    started = time.process_time()
    call()
    return time.process_time() - started


def measured(call: Callable[[], object], seconds: float, *, least: int = 3, most: int = 100) -> MeasuredTime:
    """Times of `least` to `most` calls, as many as fit into `seconds`, after an untimed one."""
    call()
    ends = time.perf_counter() + seconds
    taken: list[float] = []
    while len(taken) < least or (len(taken) < most and time.perf_counter() < ends):
        taken.append(timed(call))
    return MeasuredTime.of(taken)


def measured_in_turn(calls: Sequence[Callable[[], object]], seconds: float, *, least: int = 3) -> list[MeasuredTime]:
    """Times of several calls that always follow each other in this order; the last entry is for the whole sequence."""
    rounds: list[list[float]] = []
    for call in calls:
        call()
    ends = time.perf_counter() + seconds
    while len(rounds) < least or time.perf_counter() < ends:
        parts = [timed(call) for call in calls]
        rounds.append([*parts, sum(parts)])
    return [MeasuredTime.of(column) for column in zip(*rounds, strict=True)]
