import time

import pytest

from research.studies.progress import StudyProgress, StudyWatch
from surrogate.training.session import TrainingProgress


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The clock's time, s."""
    shown = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: shown[0])
    return shown


def test_the_time_left_counts_those_that_follow(now: list[float]) -> None:
    seen: list[StudyProgress] = []
    watch = StudyWatch(seen.append)
    watch.begin("seed 7", 2)
    watch.tell(TrainingProgress("loading", 0, 200), None)
    assert seen[-1].seconds_left is None
    now[0] += 25.0
    watch.tell(TrainingProgress("canonical", 50, 200), 75.0)
    assert seen[-1].seconds_left == 75.0 + 2 * 100.0  # each that follows takes as long as this one
    watch.expect(160.0)
    watch.tell("scoring", 6.0)
    assert (seen[-1].work, seen[-1].seconds_left) == ("scoring", 6.0 + 2 * 160.0)
    watch.begin("seed 8", 1)
    watch.tell("training", 37.5)
    assert str(seen[-1]) == "seed 8 (2 / 3)  training  3:18 in all"
    watch.begin("seed 9", 0)
    watch.tell(TrainingProgress("compression", 1, 5), 3.0)
    assert str(seen[-1]) == "seed 9 (3 / 3)  compression      1 / 5"


def test_those_that_follow_take_as_long_as_those_before_on_average(now: list[float]) -> None:
    seen: list[StudyProgress] = []
    watch = StudyWatch(seen.append, 50.0)
    watch.begin("default, seed 0", 4)
    watch.tell("measuring the speed", 50.0)
    assert seen[-1].seconds_left == 5 * 50.0
    now[0] += 30.0
    watch.end()
    watch.begin("joint, seed 0", 3)
    now[0] += 10.0
    watch.end()
    watch.begin("paper, seed 0", 2)
    watch.tell("measuring the speed", 5.0)
    assert seen[-1].seconds_left == 5.0 + 2 * 20.0
