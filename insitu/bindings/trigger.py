"""When to render in a loop: every n steps, at given times, each interval of time, when a predicate on the field holds.

A trigger remembers nothing: what it answers depends on its arguments alone, so a run that is restarted answers as one that
never stopped.  Triggers are combined by `&` and `|`.

Examples
--------
>>> from insitu.bindings.trigger import at_times, every_steps
>>> due = every_steps(100) | at_times([0.5, 2.0])
>>> due(step=130, time=0.52, previous=0.49)
True
>>> due(step=131, time=0.55, previous=0.52)
False
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

# Times are sums of steps: 0.1 added eight times is less than 0.8.  So much of a time is taken to be rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class LoopState:
    """The step, time and field of a loop.  Raises ValueError where a trigger needs what the loop did not give.

    Attributes
    ----------
    step : number of the time step; a run starts at 0.
    time : simulation time now; `previous`, that of the step before, None at a run's first look.
    field : whatever the predicates look at.
    """

    step: int | None = None
    time: float | None = None
    previous: float | None = None
    field: Any = None

    def needed(self, what: str) -> Any:
        """The attribute `what`, which must be there."""
        value = getattr(self, what)
        if value is None:
            raise ValueError(f"this trigger looks at the {what}: call it with {what}=...")
        return value

    def times(self) -> tuple[float, float | None]:
        """(time, previous), finite and in order."""
        time, previous = _finite("time", self.needed("time")), self.previous
        if previous is None:
            if self.step:
                raise ValueError(
                    f"step {self.step} needs previous=..., the time of the step before: marks between the two count. "
                    "After a restart it is the time that the run restarts from"
                )
            return time, None
        if _finite("previous", previous) > time:
            raise ValueError(f"time {time!r} lies before previous {previous!r}")
        return time, previous


@dataclass(frozen=True)
class Trigger:
    """A condition on the loop's state; made by `every_steps`, `every_interval`, `at_times`, `when_field`."""

    due: Callable[[LoopState], bool]
    text: str

    def __call__(
        self, *, step: int | None = None, time: float | None = None, previous: float | None = None, field: Any = None
    ) -> bool:
        """True if it is time to render; see `LoopState`.  Raises ValueError naming what is missing or not a number."""
        return self.due(LoopState(step, time, previous, field))

    def __and__(self, other: Trigger) -> Trigger:
        """Both hold; the second is not asked where the first does not, so a costly predicate stands last."""
        return Trigger(lambda moment: self.due(moment) and other.due(moment), f"({self.text} & {other.text})")

    def __or__(self, other: Trigger) -> Trigger:
        """At least one holds; the second is not asked where the first does."""
        return Trigger(lambda moment: self.due(moment) or other.due(moment), f"({self.text} | {other.text})")

    def __bool__(self) -> bool:
        raise TypeError(f"{self!r} is a question: call it with step=, time= or field=, and combine by & and |")

    def __repr__(self) -> str:
        return self.text


def every_steps(count: int, *, start: int = 0) -> Trigger:
    """At step `start`, and each `count` steps later; never before `start`."""
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise ValueError(f"every_steps needs a whole number of steps, at least 1, got {count!r}")

    def due(moment: LoopState) -> bool:
        since = moment.needed("step") - start
        return bool(since >= 0 and since % count == 0)

    return Trigger(due, f"every_steps({count}, start={start})")


def every_interval(interval: float, *, start: float = 0.0) -> Trigger:
    """At the first step that reaches time `start`, `start + interval`, and so on: once where a step passes several."""
    if _finite("interval", interval) <= 0:
        raise ValueError(f"every_interval needs an interval above 0, got {interval!r}")
    _finite("start", start)

    def passed(time: float) -> int:
        return max(-1, math.floor((time - start) / interval))

    def due(moment: LoopState) -> bool:
        def slack(time: float) -> float:
            return ROUNDING * max(abs(time), interval)

        now, before = moment.times()
        earlier = now - slack(now) if before is None else before + slack(before)
        return passed(now + slack(now)) > passed(earlier)

    return Trigger(due, f"every_interval({interval!r}, start={start!r})")


def at_times(times: Iterable[float]) -> Trigger:
    """At the first step that reaches each of `times`: once where a step passes several."""
    marks = sorted({_finite("a time", time) for time in times})
    if not marks:
        raise ValueError("at_times needs at least one time")

    def due(moment: LoopState) -> bool:
        now, before = moment.times()
        passed = bisect_right(marks, now + ROUNDING * abs(now))
        if before is None:
            return passed > bisect_left(marks, now - ROUNDING * abs(now))
        return passed > bisect_right(marks, before + ROUNDING * abs(before))

    return Trigger(due, f"at_times({marks})")


def when_field(predicate: Callable[[Any], Any]) -> Trigger:
    """True where `predicate(field)` is; ValueError where it answers with more than one value."""

    def due(moment: LoopState) -> bool:
        answer = predicate(moment.needed("field"))
        if getattr(answer, "size", 1) != 1:
            raise ValueError(f"the predicate answered with {answer.size} values, not one: use .any() or .all()")
        return bool(answer)

    return Trigger(due, f"when_field({getattr(predicate, '__name__', repr(predicate))})")


def _finite(what: str, value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{what} must be finite, got {value!r}")
    return number
