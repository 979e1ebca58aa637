"""Where a study of several trainings stands, and how long all of them still take."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from catalogs.progress import Count, Rate, duration, joined


@dataclass(frozen=True)
class StudyProgress:
    """Where a study stands.

    Attributes
    ----------
    name : of the current training, such as "seed 5".
    number, count : of the current training among those that had to be done.
    work : where its training or scoring stands, in words.
    seconds_left : for all of them; None before it is known.
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
    """Turns the progress of one training after the other into that of a study.

    `usual` is how many seconds each of those that follow is expected to take; None for as long as the current one.
    """

    def __init__(self, progress: Callable[[StudyProgress], None], usual: float | None = None) -> None:
        self._progress, self._usual = progress, usual
        self._name, self._number, self._following = "", 0, 0
        self._begun, self._taken = 0.0, 0.0

    def begin(self, name: str, following: int) -> None:
        """The next training begins, before so many others."""
        self._name, self._number, self._following = name, self._number + 1, following
        self._begun = time.perf_counter()

    def end(self) -> None:
        """The current training is over; those that follow are expected to take as long as it and those before, on average."""
        self._taken += time.perf_counter() - self._begun
        self._usual = self._taken / self._number

    def expect(self, seconds: float) -> None:
        """Expect those that follow to take so long each."""
        self._usual = seconds

    def counter(self, unit: str = "images") -> Callable[[str, int, int], None]:
        """What tells how many of how many are done in a stage of the current training, which takes as long as those."""
        rate = Rate()
        rate(0)

        def count(stage: str, done: int, total: int) -> None:
            at = Count(stage, done, total, rate(done), unit)
            self.tell(at, at.seconds_left)

        return count

    def tell(self, work: object, seconds_left: float | None) -> None:
        """Tell where the current training stands, and how many seconds it still takes."""
        whole = None
        if seconds_left is not None:
            current = time.perf_counter() - self._begun + seconds_left
            whole = seconds_left + self._following * (current if self._usual is None else self._usual)
        count = self._number + self._following
        self._progress(StudyProgress(self._name, self._number, count, str(work), whole))
