"""Time stepping of incompressible flows in spectral space: classical Runge-Kutta with an integrating factor.

A flow's modes û obey dû/dt = N(û) - ν k² û.  With the integrating factor exp(ν k² t) viscosity is solved exactly, so
that only the advection N limits the step.  Source: Canuto, Hussaini, Quarteroni & Zang 1988, Spectral Methods in Fluid
Dynamics, section 4.4.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Modes = NDArray[Any]
Tendency = Callable[[Modes, Modes], float]
"""(modes, out): writes N(modes) into `out` and returns max(|u| + |v| + |w|) over the grid."""


@dataclass(frozen=True)
class FlowState:
    """A flow at one moment: its spectral coefficients, laid out as the flow that made them says."""

    time: float
    modes: Modes = field(repr=False)


def steps(
    state: FlowState,
    until: float,
    *,
    tendency: Tendency,
    decay: Callable[[float], Modes],
    step_limit: float,
) -> Iterator[FlowState]:
    """States after each time step from `state` (not included) to exactly `until`.

    Parameters
    ----------
    tendency : the advection; its buffers may be reused between calls.
    decay : the viscous factor exp(-ν k² Δt) over a time Δt, of a shape that multiplies modes.
    step_limit : the longest step times the speed max(|u| + |v| + |w|): CFL number times grid spacing.

    Every state owns its array.  The steps that remain are kept equal, so there is no sliver at the end.
    Raises ValueError where `until` lies before the state, FloatingPointError where the flow has blown up.
    """
    if not until >= state.time or math.isinf(until):
        raise ValueError(f"until must be a time from {state.time:g} (the state's) on, got {until}")
    modes, time = state.modes, float(state.time)
    slope, stage, start = np.empty_like(modes), np.empty_like(modes), np.empty_like(modes)
    while time < until:
        speed = tendency(modes, slope)
        if not math.isfinite(speed):
            raise FloatingPointError(f"the flow is not finite any more at t = {time:g}: lower cfl")
        remaining = math.ceil((until - time) * speed / step_limit * (1.0 - 1e-12)) or 1
        dt = (until - time) / remaining
        modes = _step(modes, dt, decay(dt / 2.0), tendency, slope, stage, start)
        time = until if remaining == 1 else time + dt
        yield FlowState(time, modes)


def last_of(states: Iterable[FlowState], start: FlowState) -> FlowState:
    """The last of the states; `start` where there is none."""
    last = deque(states, maxlen=1)
    return last[0] if last else start


def _step(modes: Modes, dt: float, decay: Modes, tendency: Tendency, slope: Modes, stage: Modes, start: Modes) -> Modes:
    """One step; `slope` holds N(modes) on entry, `decay` is the viscous factor over half the step."""
    np.multiply(modes, decay, out=start)
    np.multiply(slope, dt / 2.0, out=stage)
    stage += modes
    stage *= decay
    slope *= dt / 6.0
    result = modes + slope
    result *= decay

    tendency(stage, slope)
    np.multiply(slope, dt / 2.0, out=stage)
    stage += start
    slope *= dt / 3.0
    result += slope

    tendency(stage, slope)
    np.multiply(slope, dt, out=stage)
    stage += start
    stage *= decay
    slope *= dt / 3.0
    result += slope
    result *= decay

    tendency(stage, slope)
    slope *= dt / 6.0
    result += slope
    return result
