"""The fields of the Taylor-Green vortex for scenes: at one time, or at the dumps of a run."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import joined_names
from insitu.simulations import Field, Simulation
from insitu.simulations.runge_kutta import FlowState
from insitu.simulations.taylor_green import NEVER, TaylorGreen


def _magnitude(vector: NDArray[Any]) -> NDArray[Any]:
    """(3, z, y, x) to (z, y, x)."""
    return np.asarray(np.sqrt(np.einsum("i...,i...->...", vector, vector)))


FIELDS: dict[str, tuple[str, Callable[[TaylorGreen, FlowState], NDArray[Any]]]] = {
    "q_criterion": ("Q", lambda flow, state: flow.q_criterion(state)),
    "speed": ("|u|", lambda flow, state: _magnitude(flow.velocity(state))),
    "vorticity": ("|∇ x u|", lambda flow, state: _magnitude(flow.vorticity(state))),
}
"""What a scene may show of the flow: a symbol, and how it is had on the grid points (z, y, x)."""


def run_fields(
    parameters: Mapping[str, float],
    *,
    fields: Sequence[str],
    resolution: int,
    time: float,
    progress: Callable[[float], Any] | None = None,
    solver_resolution: int | None = None,
) -> dict[str, Field]:
    """Some of `FIELDS` at `time` for the Reynolds number `parameters["Re"]`, on `resolution`³ points.

    With a finer `solver_resolution` the flow is solved on more points and then coarsened: small eddies that the field
    cannot hold still act on those it does.  At t = 5 that is what makes 64³ a converged field.

    Raises ValueError where parameters other than Re are given or Re is missing, for resolutions that cannot be and for unknown
    fields.
    """
    flow = _flow(parameters, fields, resolution, solver_resolution)
    state = start = flow.initial()
    for state in flow.steps(start, time):
        if progress is not None:
            progress(state.time / time)
    return _fields(fields, flow, state, resolution)


def dumps(
    parameters: Mapping[str, float],
    *,
    fields: Sequence[str],
    resolution: int,
    times: Sequence[float],
    progress: Callable[[float], Any] | None = None,
    solver_resolution: int | None = None,
) -> Iterator[dict[str, Field]]:
    """The fields of `run_fields` at each of the ascending `times` of one run.

    The run takes the longest steps that the CFL number allows and branches off a shorter one to each dump, so that a dump does not
    depend on the others.  (`run_fields` makes its steps equal, and differs by the error of the time step.)

    Raises ValueError as `run_fields` does, and for times that are negative, not finite or not ascending.
    """
    flow = _flow(parameters, fields, resolution, solver_resolution)
    ascending = all(before < after for before, after in itertools.pairwise([*times, NEVER]))
    if not ascending or any(time < 0.0 for time in times):
        raise ValueError(f"the times of dumps must ascend from 0 on, got {list(times)}")
    return _dumps(flow, fields, resolution, times, progress or (lambda fraction: None))


def _dumps(
    flow: TaylorGreen, fields: Sequence[str], resolution: int, times: Sequence[float], progress: Callable[[float], Any]
) -> Iterator[dict[str, Field]]:
    state = after = flow.initial()
    steps = flow.steps(state, NEVER)
    dumped = 0.0
    for time in times:
        while after.time < time:
            state, after = after, next(steps)
            progress(max(0.0, (min(after.time, time) - dumped) / (time - dumped)))
        yield _fields(fields, flow, flow.advance(state if after.time > time else after, until=time), resolution)
        dumped = time


def _flow(
    parameters: Mapping[str, float], fields: Sequence[str], resolution: int, solver_resolution: int | None
) -> TaylorGreen:
    """The solver; raises ValueError for what can't be solved or shown."""
    if set(parameters) != {"Re"}:
        raise ValueError(f"the Taylor-Green vortex has the one parameter Re, got {joined_names(sorted(parameters))}")
    SIMULATION.check_fields(fields)
    field_flow = TaylorGreen(resolution=resolution, reynolds=float(parameters["Re"]))
    flow = field_flow if solver_resolution is None else replace(field_flow, resolution=solver_resolution)
    if flow.resolution < resolution:
        raise ValueError(f"solver_resolution must be at least the field's {resolution}, got {solver_resolution}")
    return flow


def _fields(fields: Sequence[str], flow: TaylorGreen, state: FlowState, resolution: int) -> dict[str, Field]:
    flow, state = flow.coarsened(state, resolution)
    return {name: _field(name, flow, state) for name in fields}


def _field(name: str, flow: TaylorGreen, state: FlowState) -> Field:
    symbol, values = FIELDS[name]
    return Field(values(flow, state), flow.spacing, flow.origin, name=symbol, unit="", time=state.time)


SIMULATION = Simulation("taylor_green", ("Re",), tuple(FIELDS), run_fields, dumps)
run = SIMULATION.run
