"""The time stepper on one mode whose solution is known: û(t) = exp((iω - ν) t)."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from insitu.simulations.runge_kutta import FlowState, Modes, steps

OMEGA, VISCOSITY = 1.0, 0.3


def rotation(modes: Modes, out: Modes) -> float:
    np.multiply(modes, 1j * OMEGA, out=out)
    return 1.0


def decay(dt: float) -> Modes:
    return np.exp(np.array([-VISCOSITY * dt]))


def one() -> FlowState:
    return FlowState(0.0, np.ones(1, dtype=np.complex128))


def solve(step: float, until: float = 2.0) -> list[FlowState]:
    return list(steps(one(), until, tendency=rotation, decay=decay, step_limit=step))


def test_fourth_order_in_the_step():
    exact = np.exp((1j * OMEGA - VISCOSITY) * 2.0)
    errors = [abs(solve(step)[-1].modes[0] - exact) for step in (0.2, 0.1, 0.05)]
    orders = [np.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]
    assert orders == pytest.approx([4.0, 4.0], abs=0.1), f"errors {errors}"


def test_viscosity_alone_is_exact_in_one_step():
    def still(modes: Modes, out: Modes) -> float:
        out[...] = 0.0
        return 0.0

    found = list(steps(one(), 5.0, tendency=still, decay=decay, step_limit=0.1))
    assert len(found) == 1
    assert found[0].modes[0] == pytest.approx(np.exp(-5.0 * VISCOSITY), rel=1e-14)


def test_steps_are_equal_and_end_exactly():
    times = [0.0] + [state.time for state in solve(0.3, until=1.0)]
    assert times[-1] == 1.0
    assert np.diff(times) == pytest.approx([0.25] * 4)


def test_a_state_stays_as_it_was_when_time_goes_on():
    seen, copies = [], []
    for state in steps(one(), 1.0, tendency=rotation, decay=decay, step_limit=0.3):
        seen.append(state)
        copies.append(state.modes.copy())
    assert len(seen) == 4
    for state, copy in zip(seen, copies, strict=True):
        assert state.modes == pytest.approx(copy, rel=0.0, abs=0.0)


def test_no_step_to_the_present():
    assert list(steps(one(), 0.0, tendency=rotation, decay=decay, step_limit=0.1)) == []


@pytest.mark.parametrize("until", [-1.0, np.nan, np.inf])
def test_the_end_must_lie_ahead(until: float):
    with pytest.raises(ValueError, match=f"got {until}"):
        next(steps(one(), until, tendency=rotation, decay=decay, step_limit=0.1))


def test_a_flow_that_blew_up_is_named():
    def explosion(modes: Modes, out: Modes) -> float:
        return float("nan")

    with pytest.raises(FloatingPointError, match="t = 0: lower cfl"):
        next(steps(one(), 1.0, tendency=explosion, decay=decay, step_limit=0.1))
