"""Training of a method for a given processor time; validation images are scored off the clock."""

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

PROBE = 0.1  # fraction of the time that is spent on measuring the speed first
ROUGH_STEPS, MOST_PROBED = 3, 400
LOOKS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)  # fractions of the steps after which validation images are scored
REPORT_SECONDS = 2.0

Clock = Callable[[], float]
Point = tuple[float, float]  # seconds on the clock, dB


class OutOfTime(Exception):
    """A training stopped at its time limit; its checkpoint is kept."""


@dataclass(eq=False)
class Watch:
    """A stopwatch; `clock` says how time passes while it runs."""

    clock: Clock = time.process_time
    _taken: float = 0.0
    _since: float | None = field(default=None)

    def start(self) -> None:
        """Start the stopwatch."""
        self._since = self.clock()

    def stop(self) -> None:
        """Stop the stopwatch."""
        self._taken, self._since = self.seconds, None

    @property
    def seconds(self) -> float:
        """Seconds that it has run for."""
        return self._taken + (0.0 if self._since is None else self.clock() - self._since)


@dataclass(eq=False)
class CheckpointPath:
    """The checkpoint of a training, and the time at which the training stops.

    Attributes
    ----------
    folder : of the checkpoint; a new checkpoint replaces the previous one.
    identity : of method, images and plan; a checkpoint with another identity is ignored.
    until : `time.monotonic()` after which `keep` writes a checkpoint and raises `OutOfTime`. It also does so where an
        engine has cancelled the training.
    every : seconds between checkpoints.
    """

    folder: Path
    identity: str
    until: float = math.inf
    every: float = 120.0
    _last: float = field(default_factory=time.monotonic)

    def checkpoint(self) -> Checkpoint | None:
        """The checkpoint of an interrupted training; None without one."""
        checkpoint = Checkpoint.load(self.folder)
        return checkpoint if checkpoint is not None and checkpoint.record.get("identity") == self.identity else None

    def keep(self, fit: Fit, record: Mapping[str, Any]) -> None:
        """Write a checkpoint if one is due."""
        ends = time.monotonic() >= self.until or stop_requested()
        if ends or time.monotonic() - self._last > self.every:
            Checkpoint(fit.state(), {**record, "identity": self.identity}).save(self.folder)
            self._last = time.monotonic()
        if ends:
            raise OutOfTime("the time is over")


@dataclass(frozen=True, eq=False)
class FinishedFit:
    """A method after its last step: its plan, the seconds since its images were loaded, and its validation curve."""

    fit: Fit
    plan: Plan
    seconds: float
    curve: Sequence[Point]


def steps_in(
    method: Method, pictures: TrainingImages, plan: Plan, prepared: Prepared, seconds: float, clock: Clock
) -> int:
    """Number of steps that fit into `seconds`, at least one.

    Short trainings that go through the whole schedule are timed, since early and late steps may take different times.
    The time before the first step is subtracted.
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
    """Train a method for about `seconds`, from the loading of `pictures` to the last step.

    The plan's number of steps is replaced by as many as fit; without `seconds` it is kept. `look` returns the PSNR (dB)
    of validation images, and is called after the fractions `LOOKS` of the steps. With a `place`, checkpoints are
    written there, and an interrupted training resumes from the last one. Raises `Diverged` where a loss is not finite,
    and `OutOfTime` as described in `CheckpointPath`.
    """
    watch = Watch(clock)
    watch.start()
    images = pictures()
    watch.stop()
    checkpoint = None if place is None else place.checkpoint()
    if checkpoint is not None:
        now = _resumed(method, images, plan, prepared, checkpoint, clock)
    else:
        if seconds is not None:
            plan = replace(plan, steps=steps_in(method, images, plan, prepared, seconds - watch.seconds, clock))
        watch.start()
        now = _Running(method.begin(images, plan, prepared), plan, watch)
        watch.stop()
    looks, reported = {max(1, round(part * now.plan.steps)) for part in LOOKS}, time.perf_counter()
    now.watch.start()
    for step in range(now.step + 1, now.plan.steps + 1):
        loss = now.fit.advance()
        if step in looks or time.perf_counter() - reported > REPORT_SECONDS:
            now.watch.stop()
            if not math.isfinite(loss):
                raise Diverged(f"{method.title} diverged at step {step:,} of {now.plan.steps:,}: its loss is {loss}")
            if step in looks and look is not None:
                now.curve.append((now.watch.seconds, look(now.fit)))
            report(step, now.plan.steps)
            if place is not None:
                place.keep(now.fit, now.record(step))
            reported = time.perf_counter()
            now.watch.start()
    now.watch.stop()
    return FinishedFit(now.fit, now.plan, now.watch.seconds, now.curve)


@dataclass(eq=False)
class _Running:
    fit: Fit
    plan: Plan
    watch: Watch
    curve: list[Point] = field(default_factory=list)
    step: int = 0  # the last finished step

    def record(self, step: int) -> dict[str, Any]:
        return {"steps": self.plan.steps, "step": step, "seconds": self.watch.seconds, "curve": self.curve}


def _resumed(
    method: Method, pictures: TrainingImages, plan: Plan, prepared: Prepared, checkpoint: Checkpoint, clock: Clock
) -> _Running:
    """The training that wrote a checkpoint; loading and preparing it again are off the clock."""
    plan, step = replace(plan, steps=checkpoint.record["steps"]), checkpoint.record["step"]
    fit = method.begin(pictures, plan, prepared)
    fit.restore(step, checkpoint.tensors)
    curve = [(seconds, psnr) for seconds, psnr in checkpoint.record["curve"]]
    return _Running(fit, plan, Watch(clock, checkpoint.record["seconds"]), curve, step)


def _pace(method: Method, pictures: TrainingImages, plan: Plan, prepared: Prepared, clock: Clock) -> float:
    """Seconds per step over a whole schedule of `plan.steps`, without the first step where there are others."""
    fit = method.begin(pictures, plan, prepared)
    fit.advance()
    begun = clock()
    for _ in range(plan.steps - 1):
        fit.advance()
    return max((clock() - begun) / max(1, plan.steps - 1), 1e-6)
