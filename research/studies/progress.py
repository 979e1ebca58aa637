"""Progress of a study of several trainings, with an estimate of the remaining time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from catalogs.progress import Count, Rate, duration, joined


@dataclass(frozen=True)
class StudyProgress:
    """Progress of a study.

    Attributes
    ----------
    name : name of the current training, such as "seed 5".
    number, count : number of the current training, and of all trainings of this run.
    work : progress of its training or scoring, in words.
    seconds_left : estimate for all trainings; None before it is known.
    """

    name: str
    number: int
    count: int
    work: str
    seconds_left: float | None

    def __str__(self) -> str:
        whole = self.seconds_left if self.number < self.count else None
        in_all = "" if whole is None else f"{duration(whole)} in all"
        return joined(f"{self.name} ({self.number} / {self.count})", self.work, in_all)


class StudyWatch:
    """Combines the progress of successive trainings into that of a study.

    `usual` is the expected time in seconds of each later training; None for that of the current one.
    """

    def __init__(self, progress: Callable[[StudyProgress], None], usual: float | None = None) -> None:
        self._progress, self._usual = progress, usual
        self._name, self._number, self._following = "", 0, 0
        self._begun, self._taken = 0.0, 0.0

    def begin(self, name: str, following: int) -> None:
        """Begin the next training, before `following` others."""
        self._name, self._number, self._following = name, self._number + 1, following
        self._begun = time.perf_counter()

    def end(self) -> None:
        """End the current training; later ones are expected to take the mean time of all so far."""
        self._taken += time.perf_counter() - self._begun
        self._usual = self._taken / self._number

    def expect(self, seconds: float) -> None:
        """Set the expected time in seconds of each later training."""
        self._usual = seconds

    def counter(self, unit: str = "images") -> Callable[[str, int, int], None]:
        """A function that reports finished and total units of a stage of the current training."""
        rate = Rate()
        rate(0)

        def count(stage: str, done: int, total: int) -> None:
            at = Count(stage, done, total, rate(done), unit)
            self.tell(at, at.seconds_left)

        return count

    def tell(self, work: object, seconds_left: float | None) -> None:
        """Report the progress of the current training, and the seconds that it still takes."""
        whole = None
        if seconds_left is not None:
            current = time.perf_counter() - self._begun + seconds_left
            whole = seconds_left + self._following * (current if self._usual is None else self._usual)
        count = self._number + self._following
        self._progress(StudyProgress(self._name, self._number, count, str(work), whole))
