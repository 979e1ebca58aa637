"""The progress of an ensemble: counts, rates and time left."""

from __future__ import annotations

import io
import re

import pytest

from insitu import progress
from insitu.progress import EnsembleProgress, ProgressLine, Tracker, duration
from insitu.workers import Report


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that the test moves."""
    time = [100.0]
    monkeypatch.setattr(progress.clock, "perf_counter", lambda: time[0])
    return time


def test_time_left_follows_the_work_done(now: list[float]) -> None:
    tracker = Tracker(4, 100, field_share=0.5)
    tracker.report(Report("a", "simulate", 0.5))
    now[0] += 10.0
    state = tracker.snapshot()
    assert state.seconds_left == pytest.approx((4 - 0.25) * 10.0 / 0.25)
    assert state.running == ("simulate a 50 %",)
    tracker.report(Report("a", "render", 0.0, 50))
    now[0] += 20.0
    state = tracker.snapshot()
    assert state.images_done == 50
    assert state.seconds_left == pytest.approx((4 - 0.75) * 30.0 / 0.75)
    tracker.timed(30.0, 10.0)
    tracker.done("a", 100)
    now[0] += 10.0
    assert tracker.snapshot().seconds_left == pytest.approx(3 * 40.0)


def test_a_failed_member_is_no_longer_waited_for(now: list[float]) -> None:
    tracker = Tracker(2, 10, field_share=0.0)
    tracker.report(Report("a", "render", 0.0, 3))
    tracker.failed("a")
    tracker.done("b", 10)
    now[0] += 5.0
    state = tracker.snapshot()
    assert (state.members_done, state.members, state.images_done, state.images) == (1, 1, 10, 10)
    assert state.seconds_left == 0.0


def test_the_rate_is_of_late(now: list[float]) -> None:
    tracker = Tracker(1, 1000, field_share=0.0)
    images = 0
    for rate in [1] * 60 + [10] * 30:
        now[0] += 1.0
        images += rate
        tracker.report(Report("a", "render", 0.0, images))
        state = tracker.snapshot()
    assert state.images_per_second == pytest.approx(10.0, rel=0.01)


@pytest.mark.parametrize(("seconds", "text"), [(0, "0:00"), (59.6, "1:00"), (61, "1:01"), (3725, "1:02:05")])
def test_durations_read_like_a_clock(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_a_terminal_gets_one_line_and_messages_above_it() -> None:
    stream = Terminal()
    line = ProgressLine(stream)
    line(EnsembleProgress(1, 2, 30, 60, 12.5, (), 4.0))
    line.say("Warning: something")
    line(EnsembleProgress(2, 2, 60, 60))
    line.close()
    shown = re.sub(r"[^\n]*\r", "", stream.getvalue())  # what stays visible
    assert shown.splitlines()[0] == "Warning: something"
    assert shown.splitlines()[1].split("  ")[:2] == ["2/2 members", "60/60 images"]


def test_a_log_gets_a_line_now_and_then() -> None:
    stream = io.StringIO()
    line = ProgressLine(stream)
    for _ in range(100):
        line("working")
    line.close()
    assert stream.getvalue() == "working\n"
