"""The progress of an ensemble: counts, rates and time left."""

from __future__ import annotations

import time

import pytest

from insitu.ensembles.progress import EnsembleProgress, Tracker
from insitu.ensembles.workers import WorkerReport


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that the test moves."""
    shown = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: shown[0])
    return shown


def test_time_left_follows_the_work_done(now: list[float]) -> None:
    tracker = Tracker(4, 100, field_share=0.5)
    tracker.report(WorkerReport("a", "simulate", 0.5))
    now[0] += 10.0
    state = tracker.snapshot()
    assert state.seconds_left == pytest.approx((4 - 0.25) * 10.0 / 0.25)
    assert state.running == ("simulate a 50 %",)
    tracker.report(WorkerReport("a", "render", 0.0, 50))
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
    tracker.report(WorkerReport("a", "render", 0.0, 3))
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
        tracker.report(WorkerReport("a", "render", 0.0, images))
        state = tracker.snapshot()
    assert state.images_per_second == pytest.approx(10.0, rel=0.01)


def test_what_is_known_is_told() -> None:
    assert str(EnsembleProgress(1, 2, 0, 0)) == "1 / 2 members"
    told = EnsembleProgress(1, 2, 30, 60, 12.5, ("simulate b 45 %",), 4.0)
    assert str(told) == "1 / 2 members  30 / 60 images  12.5 images/s  simulate b 45 %  0:04 left"
