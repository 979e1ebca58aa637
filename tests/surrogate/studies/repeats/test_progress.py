import pytest

from surrogate.studies.repeats import progress as module
from surrogate.studies.repeats.progress import RepeatProgress, RepeatWatch
from surrogate.training.progress import TrainingProgress


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the clock shows, s."""
    now = [0.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    return now


def test_the_time_left_counts_the_seeds_that_follow(time: list[float]) -> None:
    seen: list[RepeatProgress] = []
    watch = RepeatWatch(3, seen.append)
    watch.begin(7)
    watch.training(TrainingProgress("loading", 0, 200))
    assert seen[-1].seconds_left is None
    watch.training(TrainingProgress("canonical", 50, 200, rate=2.0, seconds_left=75.0))
    assert seen[-1].seconds_left == 75.0 + 2 * 100.0  # 200 steps at 2 steps/s for each that follows
    watch.trained(160.0)
    time[0] += 4.0
    watch.scoring("scoring", 40, 100)
    assert seen[-1].work == "scoring  40 / 100 images  10/s  0:06 left"
    assert seen[-1].seconds_left == 6.0 + 2 * 160.0
    watch.begin(8)
    watch.training(TrainingProgress("canonical", 50, 200, rate=4.0, seconds_left=37.5))
    assert seen[-1].seconds_left == 37.5 + 160.0  # as long as the finished one took
    assert (
        str(seen[-1])
        == f"seed 8 (2 / 3)  {TrainingProgress('canonical', 50, 200, 4.0, seconds_left=37.5)}  0:03:17 in all"
    )
    watch.begin(9)
    watch.training(TrainingProgress("needs", 1, 5))
    assert str(seen[-1]) == "seed 9 (3 / 3)  needs            1 / 5"
