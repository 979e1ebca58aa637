"""Where repeated training stands, and how long it still takes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

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
        parts = [f"seed {self.seed} ({self.number} / {self.count})", self.work]
        if self.seconds_left is not None and self.number < self.count:
            minutes = int(self.seconds_left) // 60
            parts.append(f"{minutes // 60}:{minutes % 60:02d}:{int(self.seconds_left) % 60:02d} in all")
        return "  ".join(parts)


class RepeatWatch:
    """Turns the progress of one seed's training and scoring into that of all `count` seeds."""

    def __init__(self, count: int, progress: Callable[[RepeatProgress], None]) -> None:
        self._count, self._progress = count, progress
        self._seed, self._number = 0, 0
        self._known: float | None = None  # seconds that the training of the last finished seed took
        self._usual = 0.0
        self._stage_begun = time.perf_counter()

    def begin(self, seed: int) -> None:
        """The next seed begins."""
        self._seed, self._number = seed, self._number + 1

    def trained(self, seconds: float) -> None:
        """The current seed's training took so long in all, also before it was interrupted; its images are scored next."""
        self._known, self._usual, self._stage_begun = seconds, seconds, time.perf_counter()

    def training(self, training: TrainingProgress) -> None:
        """Tell where training stands."""
        left = training.seconds_left
        if self._known is None and training.rate:
            self._usual = training.steps / training.rate
        self._tell(str(training), left)

    def scoring(self, stage: str, done: int, total: int) -> None:
        """Tell how many images are scored."""
        rate = done / max(time.perf_counter() - self._stage_begun, 1e-3)
        left = (total - done) / rate
        work = f"{stage}  {done} / {total} images  {rate:.0f}/s  {int(left) // 60}:{int(left) % 60:02d} left"
        self._tell(work, left)

    def _tell(self, work: str, left: float | None) -> None:
        whole = None if left is None else left + (self._count - self._number) * self._usual
        self._progress(RepeatProgress(self._seed, self._number, self._count, work, whole))
