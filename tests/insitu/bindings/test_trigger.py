"""When to render: marks are met once each, whatever the steps are, and a restart changes nothing."""

import numpy as np
import pytest

from insitu.bindings.trigger import Trigger, at_times, every_interval, every_steps, when_field


def rendered(trigger: Trigger, times: list[float], first: int = 0) -> list[int]:
    """Steps that `trigger` renders; `first`: the step restarted from, which is not looked at again."""
    numbers = range(first + 1 if first else 0, len(times))
    return [n for n in numbers if trigger(step=n, time=times[n], previous=times[n - 1] if n else None)]


@pytest.mark.parametrize(
    ("count", "start", "steps"), [(1, 0, [0, 1, 2, 3, 4, 5, 6]), (3, 0, [0, 3, 6]), (3, 2, [2, 5]), (9, 0, [0])]
)
def test_every_steps(count: int, start: int, steps: list[int]) -> None:
    assert [n for n in range(7) if every_steps(count, start=start)(step=n)] == steps


SUMS = list(np.cumsum([0.0] + [0.1] * 20))  # 0.1 added up: below 0.8 at the eighth, above 0.3 at the third


@pytest.mark.parametrize(
    ("trigger", "times", "steps"),
    [
        (every_interval(0.1), SUMS, list(range(21))),
        (every_interval(0.4), SUMS, [0, 4, 8, 12, 16, 20]),
        (every_interval(1.0), [0.0, 0.4, 3.7, 3.9, 4.0], [0, 2, 4]),  # one step over three marks
        (every_interval(1.0, start=2.0), [0.0, 1.9, 2.0, 2.5, 3.1], [2, 4]),
        (every_interval(1.0, start=2.0), [0.0, 5.5, 5.9], [1]),
        (every_interval(1.0), [0.5, 0.9, 1.0], [2]),  # a run that does not start at a mark
        (every_interval(2.0), [-4.0, -1.0, 0.5], [2]),  # none before the start
        (at_times([0.8, 0.3]), SUMS, [3, 8]),
        (at_times([0, 1, 2, 9]), [0.0, 2.5, 2.6, 8.9, 1e9], [0, 1, 4]),
        (at_times([1.0]), [1.0, 1.0, 1.1], [0]),  # a step of no length
        (at_times([0.1]), [0.2, 0.3], []),  # over before the run began
    ],
    ids=str,
)
def test_each_mark_is_met_by_the_first_step_that_reaches_it(
    trigger: Trigger, times: list[float], steps: list[int]
) -> None:
    assert rendered(trigger, times) == steps
    for restart in range(1, len(times)):
        assert rendered(trigger, times, restart) == [n for n in steps if n > restart]


def test_steps_of_any_lengths_meet_each_interval_once() -> None:
    lengths = np.random.default_rng(0).exponential(0.3, size=500)
    times = [0.0, *np.cumsum(lengths).tolist()]
    expected = [n for n in range(1, len(times)) if int(times[n]) != int(times[n - 1])]
    assert rendered(every_interval(1.0), times) == [0, *expected]
    assert rendered(at_times(range(200)), times) == [0, *expected]


def test_predicates_are_asked_only_where_they_decide() -> None:
    asked: list[int] = []

    def steep(field: np.ndarray) -> np.bool_:
        asked.append(1)
        return (field > 1).any()

    both, either = every_steps(2) & when_field(steep), every_steps(2) | when_field(steep)
    low, high = np.zeros((2, 2, 2)), np.full((2, 2, 2), 2.0)
    assert not both(step=1, field=high)
    assert either(step=0, field=low)
    assert not asked
    assert both(step=2, field=high)
    assert not both(step=2, field=low)
    assert either(step=1, field=high)
    assert not either(step=1, field=low)
    assert len(asked) == 4
    assert repr(both) == "(every_steps(2, start=0) & when_field(steep))"


@pytest.mark.parametrize(
    ("ask", "complaint"),
    [
        (lambda: every_steps(0), "at least 1, got 0"),
        (lambda: every_steps(2.5), "got 2.5"),  # type: ignore[arg-type]
        (lambda: every_interval(-1), "above 0, got -1"),
        (lambda: every_interval(float("nan")), "interval must be finite"),
        (lambda: at_times([]), "at least one time"),
        (lambda: at_times([float("inf")]), "must be finite, got inf"),
        (lambda: every_steps(2)(time=1.0), "step=..."),
        (lambda: at_times([1])(step=0), "time=..."),
        (lambda: at_times([1])(step=3, time=1.0), "step 3 needs previous"),
        (lambda: at_times([1])(time=1.0, previous=2.0), "before previous 2.0"),
        (lambda: at_times([1])(time=float("nan"), previous=0.0), "time must be finite"),
        (lambda: when_field(bool)(step=1), "field=..."),
        (lambda: when_field(lambda f: f > 1)(field=np.zeros(3)), "3 values, not one"),
    ],
)
def test_what_makes_no_sense_is_refused(ask, complaint: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match=complaint):
        ask()


def test_and_between_triggers_is_refused_for_it_would_drop_one() -> None:
    with pytest.raises(TypeError, match=r"combine by & and \|"):
        every_steps(2) and every_steps(3)
