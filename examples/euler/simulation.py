"""CloverLeaf3D's problem, solved by PyClaw: three states of an ideal gas, released from rest in a box with reflecting walls."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from insitu.fields.field import Field

with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):  # PyClaw opens a log in the working directory
    from clawpack import pyclaw, riemann

GAMMA = 1.4
SIZE = 10.0  # edge of the cubic box, whose low corner is the origin
CUBOIDS = {  # of states 2 and 3, (low, high) along x, y and z; state 1 is everywhere else
    2: ((0.0, 5.0), (0.0, 4.0), (0.0, 4.0)),
    3: ((6.0, 8.5), (5.0, 7.5), (4.0, 8.0)),
}
DENSITY, ENERGY = 0, 4  # conserved quantities of PyClaw's state; those between are momenta


def simulate(parameters: Mapping[str, float], cells: int, time: float) -> Field:
    """The specific internal energy at `time`, at the centres of cells; parameters are the states' `density_i` and `energy_i`."""
    _, energy = solve(parameters, cells, time)
    width = SIZE / cells
    return Field(energy.astype(np.float32), (width,) * 3, (width / 2,) * 3, name="energy", time=time)


def solve(parameters: Mapping[str, float], cells: int, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Density and specific internal energy at `time`, each [z, y, x], means over cells."""
    claw = pyclaw.Controller()
    claw.solution, claw.solver = _at_rest(parameters, cells), _solver()
    claw.tfinal, claw.num_output_times = time, 1
    claw.output_format, claw.verbosity = None, 0  # nothing is written: the field goes to the hook
    claw.run()
    density, *momenta, energy = claw.solution.state.q  # [5, x, y, z]
    kinetic = 0.5 * sum(momentum**2 for momentum in momenta) / density
    return density.T, ((energy - kinetic) / density).T


def _at_rest(parameters: Mapping[str, float], cells: int) -> pyclaw.Solution:
    domain = pyclaw.Domain([pyclaw.Dimension(0.0, SIZE, cells, name=name) for name in "xyz"])
    state = pyclaw.State(domain, 5)
    state.problem_data["gamma"] = GAMMA
    state.q[...] = 0.0
    low, high = np.arange(cells) * SIZE / cells, np.arange(1, cells + 1) * SIZE / cells
    _fill(state.q, ..., parameters, 1)
    for number, cuboid in CUBOIDS.items():  # as CloverLeaf does: every cell that the cuboid touches
        cut = np.ix_(*((high >= first) & (low < last) for first, last in cuboid))
        _fill(state.q, cut, parameters, number)
    return pyclaw.Solution(state, domain)


def _fill(q: NDArray[np.float64], cut: object, parameters: Mapping[str, float], number: int) -> None:
    density, energy = parameters[f"density_{number}"], parameters[f"energy_{number}"]
    q[DENSITY][cut], q[ENERGY][cut] = density, density * energy


def _solver() -> pyclaw.ClawSolver3D:
    solver = pyclaw.ClawSolver3D(riemann.euler_3D)
    solver.dimensional_split = True
    solver.limiters = pyclaw.limiters.tvd.MC
    solver.cfl_max, solver.cfl_desired = 1.0, 0.9
    solver.all_bcs = pyclaw.BC.wall
    return solver
