"""A method trained for a given processor time, with looks at validation images off the clock."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from catalogs.engines.stopping import stop_requested
from research.studies.baselines.method import Fit, Method, Plan, Prepared, TrainingImages
from surrogate.storage.checkpoints import Checkpoint
from surrogate.training.loop import Diverged

PROBE = 0.1  # of the time, in which the speed is measured beforehand
ROUGH_STEPS, MOST_PROBED = 3, 400
LOOKS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)  # of the steps, after which validation images are looked at
REPORT_SECONDS = 2.0

Clock = Callable[[], float]
Point = tuple[float, float]  # seconds on the clock, dB


class OutOfTime(Exception):
    """A training stopped because it was to; its checkpoint is kept."""


@dataclass(eq=False)
class Watch:
    """A clock that can be stopped; `clock` says how time passes while it runs."""

    clock: Clock = time.process_time
    _taken: float = 0.0
    _since: float | None = field(default=None)

    def start(self) -> None:
        """Let time pass."""
        self._since = self.clock()

    def stop(self) -> None:
        """Let no more time pass."""
        self._taken, self._since = self.seconds, None

    @property
    def seconds(self) -> float:
        """That it ran for so far."""
        return self._taken + (0.0 if self._since is None else self.clock() - self._since)


@dataclass(eq=False)
class CheckpointPath:
    """Where a training keeps checkpoints, and when it stops to go on another day.

    Attributes
    ----------
    folder : of the checkpoint, which is replaced.
    identity : of method, pictures and plan: a checkpoint of another one is none.
    until : `time.monotonic()` after which `keep` raises `OutOfTime`, once a checkpoint is written; it does so too on the worker
        of an engine that took the training back.
    every : seconds between checkpoints.
    """

    folder: Path
    identity: str
    until: float = math.inf
    every: float = 120.0
    _last: float = field(default_factory=time.monotonic)

    def kept(self) -> Checkpoint | None:
        """What an interrupted training left; None without any."""
        found = Checkpoint.load(self.folder)
        return found if found is not None and found.record.get("identity") == self.identity else None

    def keep(self, fit: Fit, record: Mapping[str, Any]) -> None:
        """Write a checkpoint where it is time for one."""
        ends = time.monotonic() >= self.until or stop_requested()
        if ends or time.monotonic() - self._last > self.every:
            Checkpoint(fit.state(), {**record, "identity": self.identity}).save(self.folder)
            self._last = time.monotonic()
        if ends:
            raise OutOfTime("the time is over")


@dataclass(frozen=True, eq=False)
class FinishedFit:
    """A method after its last step: its plan, the seconds that it took from the first picture on, and what looks found."""

    fit: Fit
    plan: Plan
    seconds: float
    curve: Sequence[Point]


def steps_in(
    method: Method, pictures: TrainingImages, plan: Plan, prepared: Prepared, seconds: float, clock: Clock
) -> int:
    """How many steps fit into `seconds`, at least one.

    Measured in trainings that go through all of the schedule in a few steps, since early and late ones may take unlike times; what
    comes before the first step is taken off.
    """
    begun = clock()
    pace = _pace(method, pictures, replace(plan, steps=ROUGH_STEPS), prepared, clock)
    more = min(MOST_PROBED, int((PROBE * seconds - (clock() - begun)) / pace))
    if more > 2 * ROUGH_STEPS:
        pace = _pace(method, pictures, replace(plan, steps=more), prepared, clock)
    return max(1, int(seconds / pace))


def fit_in_time(
    method: Method,
    pictures: Callable[[], TrainingImages],
    plan: Plan,
    prepared: Prepared,
    seconds: float | None,
    look: Callable[[Fit], float] | None = None,
    *,
    clock: Clock = time.process_time,
    report: Callable[[int, int], None] = lambda *_: None,
    place: CheckpointPath | None = None,
) -> FinishedFit:
    """Train a method for about `seconds`, on the clock from the loading of `pictures` to the last step.

    The steps of `plan` are replaced by as many as fit; without `seconds` they stay.  `look` judges the method by images that it
    does not learn from, in dB, after the fractions `LOOKS` of them.  With a `place` checkpoints are kept there, and an interrupted
    training goes on from the last one.  Raises `Diverged` where a loss is not finite, and `OutOfTime` as `CheckpointPath` says.
    """
    watch = Watch(clock)
    watch.start()
    learnt = pictures()
    watch.stop()
    kept = None if place is None else place.kept()
    if kept is not None:
        now = _resumed(method, learnt, plan, prepared, kept, clock)
    else:
        if seconds is not None:
            plan = replace(plan, steps=steps_in(method, learnt, plan, prepared, seconds - watch.seconds, clock))
        watch.start()
        now = _Running(method.begin(learnt, plan, prepared), plan, watch)
        watch.stop()
    looks, told = {max(1, round(part * now.plan.steps)) for part in LOOKS}, time.perf_counter()
    now.watch.start()
    for step in range(now.step + 1, now.plan.steps + 1):
        loss = now.fit.advance()
        if step in looks or time.perf_counter() - told > REPORT_SECONDS:
            now.watch.stop()
            if not math.isfinite(loss):
                raise Diverged(f"{method.title} diverged at step {step:,} of {now.plan.steps:,}: its loss is {loss}")
            if step in looks and look is not None:
                now.curve.append((now.watch.seconds, look(now.fit)))
            report(step, now.plan.steps)
            if place is not None:
                place.keep(now.fit, now.record(step))
            told = time.perf_counter()
            now.watch.start()
    now.watch.stop()
    return FinishedFit(now.fit, now.plan, now.watch.seconds, now.curve)


@dataclass(eq=False)
class _Running:
    fit: Fit
    plan: Plan
    watch: Watch
    curve: list[Point] = field(default_factory=list)
    step: int = 0  # that it began after

    def record(self, step: int) -> dict[str, Any]:
        return {"steps": self.plan.steps, "step": step, "seconds": self.watch.seconds, "curve": self.curve}


def _resumed(
    method: Method, pictures: TrainingImages, plan: Plan, prepared: Prepared, kept: Checkpoint, clock: Clock
) -> _Running:
    """What a checkpoint was kept of; loading and beginning again are off the clock."""
    plan, step = replace(plan, steps=kept.record["steps"]), kept.record["step"]
    fit = method.begin(pictures, plan, prepared)
    fit.restore(step, kept.tensors)
    curve = [(seconds, psnr) for seconds, psnr in kept.record["curve"]]
    return _Running(fit, plan, Watch(clock, kept.record["seconds"]), curve, step)


def _pace(method: Method, pictures: TrainingImages, plan: Plan, prepared: Prepared, clock: Clock) -> float:
    """Seconds that a step takes, over a whole schedule of `plan.steps`, the first one aside where there are others."""
    fit = method.begin(pictures, plan, prepared)
    fit.advance()
    begun = clock()
    for _ in range(plan.steps - 1):
        fit.advance()
    return max((clock() - begun) / max(1, plan.steps - 1), 1e-6)
