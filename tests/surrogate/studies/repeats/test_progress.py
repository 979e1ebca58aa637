import time

import pytest

from surrogate.studies.repeats.progress import RepeatProgress, RepeatWatch
from surrogate.training.progress import TrainingProgress


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the clock shows, s."""
    shown = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: shown[0])
    return shown


def test_the_time_left_counts_the_seeds_that_follow(now: list[float]) -> None:
    seen: list[RepeatProgress] = []
    watch = RepeatWatch(3, seen.append)
    watch.begin(7)
    watch.training(TrainingProgress("loading", 0, 200))
    assert seen[-1].seconds_left is None
    watch.training(TrainingProgress("canonical", 50, 200, rate=2.0, seconds_left=75.0))
    assert seen[-1].seconds_left == 75.0 + 2 * 100.0  # 200 steps at 2 steps/s for each that follows
    watch.trained(160.0)
    now[0] += 4.0
    watch.scoring("scoring", 40, 100)
    assert seen[-1].work == "scoring  40 / 100 images  10.0 images/s  0:06 left"
    assert seen[-1].seconds_left == 6.0 + 2 * 160.0
    watch.begin(8)
    watch.training(TrainingProgress("canonical", 50, 200, rate=4.0, seconds_left=37.5))
    assert seen[-1].seconds_left == 37.5 + 160.0  # as long as the finished one took
    assert (
        str(seen[-1])
        == f"seed 8 (2 / 3)  {TrainingProgress('canonical', 50, 200, 4.0, seconds_left=37.5)}  3:18 in all"
    )
    watch.begin(9)
    watch.training(TrainingProgress("needs", 1, 5))
    assert str(seen[-1]) == "seed 9 (3 / 3)  needs            1 / 5"
