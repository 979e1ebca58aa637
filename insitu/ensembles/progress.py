"""The progress of an ensemble while it runs."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

from catalogs.progress import Rate, joined, per_second, time_left
from insitu.ensembles.workers import WorkerReport


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
        return joined(
            f"{self.members_done} / {self.members} members",
            f"{self.images_done} / {self.images} images" if self.images else "",
            per_second(self.images_per_second, "images"),
            *self.running,
            time_left(self.seconds_left),
        )


class Tracker:
    """Turns workers' reports into `EnsembleProgress`.

    Time left is elapsed time over work done so far, in members; a member under way counts by its fraction.  The share of a
    member's time that its field takes is learnt from the members seen.
    """

    def __init__(self, members: int, images_per_member: int, *, field_share: float) -> None:
        self._members, self._images_per_member = members, images_per_member
        self._started = clock.perf_counter()
        self._fields: dict[str, float] = {}  # member -> fraction of its field computed
        self._images: dict[str, int] = {}  # member -> images drawn
        self._stages: dict[str, str] = {}  # members under way -> stage
        self._done: set[str] = set()
        self._rate = Rate()
        self._field_share = field_share  # of a member's time, before the first is measured
        self._field_seconds = self._render_seconds = 0.0

    def report(self, report: WorkerReport) -> None:
        if report.stage == "done":
            self.done(report.member, report.images)
            return
        if report.stage in ("failed", "stored"):
            self.idle(report.member)
            return
        self._stages[report.member] = report.stage
        if report.stage == "simulate":
            self._fields[report.member] = report.fraction
        if report.stage == "render":
            self._fields[report.member] = 1.0
            self._images[report.member] = report.images

    def timed(self, field_seconds: float, render_seconds: float) -> None:
        """Learn what a member's field and its rendering cost."""
        self._field_seconds += field_seconds
        self._render_seconds += render_seconds

    def idle(self, member: str) -> None:
        """The worker has left the member, after a pilot or a failure."""
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
        images = sum(self._images.values())
        return EnsembleProgress(
            members_done=len(self._done),
            members=self._members,
            images_done=images,
            images=self._members * self._images_per_member,
            images_per_second=self._rate(images),
            running=tuple(self._describe(m, s) for m, s in sorted(self._stages.items()) if s != "render"),
            seconds_left=self._seconds_left(clock.perf_counter() - self._started),
        )

    def _describe(self, member: str, stage: str) -> str:
        fraction = self._fields.get(member, 0.0)
        return f"{stage} {member}" + (f" {100 * fraction:.0f} %" if stage == "simulate" else "")

    def _seconds_left(self, elapsed: float) -> float | None:
        if not self._images_per_member:
            return None  # pilots: how long drawing takes is not known yet
        whole = self._field_seconds + self._render_seconds
        share = self._field_seconds / whole if whole > 0 else self._field_share
        rendered = sum(self._images.values()) / self._images_per_member
        computed = sum(self._fields.values())
        done = share * computed + (1.0 - share) * rendered  # members' worth of work
        if done <= 0.02 or elapsed < 1.0:
            return None
        return max(0.0, (self._members - done) * elapsed / done)
