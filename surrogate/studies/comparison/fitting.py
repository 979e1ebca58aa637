"""A method trained for a given processor time, with looks at validation images off the clock."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from surrogate.studies.baselines.method import Fit, Method, Pictures, Plan, Prepared

PROBE = 0.1  # of the time, in which the speed is measured beforehand
ROUGH_STEPS, MOST_PROBED = 3, 400
LOOKS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)  # of the steps, after which validation images are looked at
REPORT_SECONDS = 2.0

Clock = Callable[[], float]
Point = tuple[float, float]  # seconds on the clock, dB


class Diverged(ValueError):
    """A method's loss is not finite."""


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


@dataclass(frozen=True, eq=False)
class Fitted:
    """A method after its last step: its plan, the seconds that it took from the first picture on, and what looks found."""

    fit: Fit
    plan: Plan
    seconds: float
    curve: Sequence[Point]


def steps_in(method: Method, pictures: Pictures, plan: Plan, prepared: Prepared, seconds: float, clock: Clock) -> int:
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
    pictures: Callable[[], Pictures],
    plan: Plan,
    prepared: Prepared,
    seconds: float,
    look: Callable[[Fit], float] | None = None,
    *,
    clock: Clock = time.process_time,
    report: Callable[[int, int], None] = lambda *_: None,
) -> Fitted:
    """Train a method for about `seconds`, on the clock from the loading of `pictures` to the last step.

    The steps of `plan` are replaced by as many as fit; `look` judges the method by images that it does not learn from, in dB, after
    the fractions `LOOKS` of them.  Raises `Diverged` where a loss is not finite.
    """
    watch = Watch(clock)
    watch.start()
    learnt = pictures()
    watch.stop()
    steps = steps_in(method, learnt, plan, prepared, seconds - watch.seconds, clock)
    plan, curve, told = replace(plan, steps=steps), list[Point](), time.perf_counter()
    watch.start()
    fit = method.begin(learnt, plan, prepared)
    looks = {max(1, round(part * steps)) for part in LOOKS}
    for step in range(1, steps + 1):
        loss = fit.advance()
        if step in looks or time.perf_counter() - told > REPORT_SECONDS:
            watch.stop()
            if not math.isfinite(loss):
                raise Diverged(f"{method.title} diverged at step {step:,} of {steps:,}: its loss is {loss}")
            if step in looks and look is not None:
                curve.append((watch.seconds, look(fit)))
            report(step, steps)
            told = time.perf_counter()
            watch.start()
    watch.stop()
    return Fitted(fit, plan, watch.seconds, curve)


def _pace(method: Method, pictures: Pictures, plan: Plan, prepared: Prepared, clock: Clock) -> float:
    """Seconds that a step takes, over a whole schedule of `plan.steps`, the first one aside where there are others."""
    fit = method.begin(pictures, plan, prepared)
    fit.advance()
    begun = clock()
    for _ in range(plan.steps - 1):
        fit.advance()
    return max((clock() - begun) / max(1, plan.steps - 1), 1e-6)
