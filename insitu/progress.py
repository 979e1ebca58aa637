"""Where an ensemble stands while it runs, and the line that shows it."""

from __future__ import annotations

import sys
import time as clock
from collections import deque
from dataclasses import dataclass, field
from typing import TextIO

from insitu.workers import Report

LATELY_SECONDS = 20.0
LINE_SECONDS = 15.0  # between lines where the output is not a terminal


@dataclass(frozen=True)
class EnsembleProgress:
    """A moment of an ensemble's run.

    Attributes
    ----------
    members_done, members : rendered and asked for, in this run.
    images_done, images : likewise.
    images_per_second : over the last 20 s, all workers together; 0 while nothing is drawn.
    running : what each worker is at, such as "simulate train-003 45 %".
    seconds_left : None before the first estimate.
    """

    members_done: int
    members: int
    images_done: int
    images: int
    images_per_second: float = 0.0
    running: tuple[str, ...] = ()
    seconds_left: float | None = None

    def __str__(self) -> str:
        parts = [f"{self.members_done}/{self.members} members"]
        if self.images:
            parts.append(f"{self.images_done}/{self.images} images")
        if self.images_per_second:
            parts.append(f"{self.images_per_second:.1f} images/s")
        parts += self.running
        if self.seconds_left is not None:
            parts.append(f"{duration(self.seconds_left)} left")
        return "  ".join(parts)


class Tracker:
    """Turns workers' reports into `EnsembleProgress`.

    Time left is elapsed time over work done so far, in members, a member under way counting by its fraction;
    what part of a member's time its field takes is learnt from the members seen.
    """

    def __init__(self, members: int, images_per_member: int, *, field_share: float) -> None:
        self._members, self._images_per_member = members, images_per_member
        self._started = clock.perf_counter()
        self._fields: dict[str, float] = {}  # member -> fraction of its field computed
        self._images: dict[str, int] = {}  # member -> images drawn
        self._stages: dict[str, str] = {}  # members under way -> stage
        self._done: set[str] = set()
        self._history: deque[tuple[float, int]] = deque([(self._started, 0)])
        self._field_seconds, self._render_seconds = field_share, 1.0 - field_share
        self._measured = False

    def report(self, report: Report) -> None:
        self._stages[report.member] = report.stage
        if report.stage == "simulate":
            self._fields[report.member] = report.fraction
        if report.stage == "render":
            self._fields[report.member] = 1.0
            self._images[report.member] = report.images

    def timed(self, field_seconds: float, render_seconds: float) -> None:
        """Learn what a member's field and its rendering cost."""
        if not self._measured:
            self._field_seconds = self._render_seconds = 0.0
            self._measured = True
        self._field_seconds += field_seconds
        self._render_seconds += render_seconds

    def idle(self, member: str) -> None:
        """A pilot, or a failure: the worker has left the member."""
        self._stages.pop(member, None)

    def failed(self, member: str) -> None:
        self.idle(member)
        self._images.pop(member, None)
        self._members -= 1

    def done(self, member: str, images: int) -> None:
        self.idle(member)
        self._done.add(member)
        self._images[member] = images

    def snapshot(self) -> EnsembleProgress:
        now = clock.perf_counter()
        images = sum(self._images.values())
        self._history.append((now, images))
        while len(self._history) > 2 and now - self._history[0][0] > LATELY_SECONDS:
            self._history.popleft()
        since, before = self._history[0]
        return EnsembleProgress(
            members_done=len(self._done),
            members=self._members,
            images_done=images,
            images=self._members * self._images_per_member,
            images_per_second=max(0.0, (images - before) / (now - since)) if now > since else 0.0,
            running=tuple(self._describe(m, s) for m, s in sorted(self._stages.items()) if s != "render"),
            seconds_left=self._seconds_left(now),
        )

    def _describe(self, member: str, stage: str) -> str:
        fraction = self._fields.get(member, 0.0)
        return f"{stage} {member}" + (f" {100 * fraction:.0f} %" if stage == "simulate" else "")

    def _seconds_left(self, now: float) -> float | None:
        if not self._images_per_member:
            return None  # pilots: how long drawing takes is not known yet
        whole = self._field_seconds + self._render_seconds
        share = self._field_seconds / whole if whole > 0 else 0.0
        drawn = sum(self._images.values()) / self._images_per_member
        computed = sum(self._fields.values())
        done = share * computed + (1.0 - share) * drawn  # members' worth of work
        elapsed = now - self._started
        if done <= 0.02 or elapsed < 1.0:
            return None
        return max(0.0, (self._members - done) * elapsed / done)


@dataclass
class ProgressLine:
    """Shows progress on one rewritten line of a terminal, or as a line now and then elsewhere."""

    stream: TextIO = field(default_factory=lambda: sys.stderr)  # looked up late: it may be replaced
    _last: float = 0.0
    _width: int = 0

    def __call__(self, progress: object) -> None:
        text = str(progress)
        if self.stream.isatty():
            self.stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
        elif clock.monotonic() - self._last >= LINE_SECONDS:
            self.stream.write(text + "\n")
            self._last = clock.monotonic()
        self.stream.flush()

    def say(self, text: str) -> None:
        """Write a line of its own above the progress."""
        if self._width:
            self.stream.write("\r" + " " * self._width + "\r")
        self.stream.write(text + "\n")
        self.stream.flush()

    def close(self) -> None:
        """End the line so that what follows starts on its own."""
        if self._width:
            self.stream.write("\n")
            self.stream.flush()
            self._width = 0


def duration(seconds: float) -> str:
    """Seconds as m:ss or h:mm:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
