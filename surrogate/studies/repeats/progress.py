"""Where repeated training stands, and how long it still takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from catalogs.progress import Count, Rate, duration, joined
from surrogate.training.progress import TrainingProgress


@dataclass(frozen=True)
class RepeatProgress:
    """Where it stands.

    Attributes
    ----------
    number, count : of the current seed among those that had to be done.
    work : where its training or scoring stands, in words.
    seconds_left : for all of them; None before it is known.
    """

    seed: int
    number: int
    count: int
    work: str
    seconds_left: float | None

    def __str__(self) -> str:
        whole = self.seconds_left if self.number < self.count else None
        in_all = "" if whole is None else f"{duration(whole)} in all"
        return joined(f"seed {self.seed} ({self.number} / {self.count})", self.work, in_all)


class RepeatWatch:
    """Turns the progress of one seed's training and scoring into that of all `count` seeds."""

    def __init__(self, count: int, progress: Callable[[RepeatProgress], None]) -> None:
        self._count, self._progress = count, progress
        self._seed, self._number = 0, 0
        self._known: float | None = None  # seconds that the training of the last finished seed took
        self._usual = 0.0
        self._rate = Rate()  # of scoring

    def begin(self, seed: int) -> None:
        """The next seed begins."""
        self._seed, self._number = seed, self._number + 1

    def trained(self, seconds: float) -> None:
        """The current seed's training took so long in all, also before it was interrupted; its images are scored next."""
        self._known, self._usual, self._rate = seconds, seconds, Rate()
        self._rate(0)

    def training(self, training: TrainingProgress) -> None:
        """Tell where training stands."""
        left = training.seconds_left
        if self._known is None and training.rate:
            self._usual = training.steps / training.rate
        self._tell(str(training), left)

    def scoring(self, stage: str, done: int, total: int) -> None:
        """Tell how many images are scored."""
        count = Count(stage, done, total, self._rate(done))
        self._tell(str(count), count.seconds_left)

    def _tell(self, work: str, left: float | None) -> None:
        whole = None if left is None else left + (self._count - self._number) * self._usual
        self._progress(RepeatProgress(self._seed, self._number, self._count, work, whole))
