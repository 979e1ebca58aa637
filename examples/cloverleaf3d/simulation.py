"""CloverLeaf3D's problem, solved by CloverLeaf3D itself, which `build` compiled: each member is a run of the code.

Three states of an ideal gas are released from rest in a box with reflecting walls.  The code writes its own dump, which the
hook's reader for CloverLeaf reads.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from insitu.fields.field import Field
from insitu.readers.cloverleaf import NAME, read
from insitu.readers.reader import Sampling

CODE = Path(sys.executable).with_name("clover_leaf")
SIZE = 10.0  # edge of the cubic box, whose low corner is the origin
CUBOIDS = {  # of states 2 and 3, (low, high) along x, y and z; state 1 is everywhere else
    2: ((0.0, 5.0), (0.0, 4.0), (0.0, 4.0)),
    3: ((6.0, 8.5), (5.0, 7.5), (4.0, 8.0)),
}


def simulate(parameters: Mapping[str, float], cells: int, time: float, array: str = "energy") -> Field:
    """The specific internal energy at `time`, or another array of the dump; parameters are `density_i` and `energy_i`."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "clover.in").write_text(deck(parameters, cells, time))
        run(folder)
        field = read(last_dump(folder), array, (), Sampling())
        assert isinstance(field, Field)
        return replace(field, time=time)


def deck(parameters: Mapping[str, float], cells: int, time: float) -> str:
    """CloverLeaf3D's input file."""
    states = [f"state {number} {_gas(parameters, number)}{_place(number)}" for number in (1, *CUBOIDS)]
    grid = [f"{axis}_cells={cells}\n{axis}min=0.0\n{axis}max={SIZE}" for axis in "xyz"]
    steps = f"initial_timestep=0.04\nmax_timestep=0.04\nend_time={time:.9f}\nend_step=1000000"
    return "\n".join(["*clover", *states, *grid, steps, "visit_frequency=1000000", "*endclover", ""])


def _gas(parameters: Mapping[str, float], number: int) -> str:
    return " ".join(f"{name}={parameters[f'{name}_{number}']:.9f}" for name in ("density", "energy"))


def _place(number: int) -> str:
    if number not in CUBOIDS:
        return ""
    bounds = (f"{axis}min={low} {axis}max={high}" for axis, (low, high) in zip("xyz", CUBOIDS[number], strict=True))
    return " geometry=cuboid " + " ".join(bounds)


def run(folder: Path) -> None:
    """Run the code in `folder` on one core; raises RuntimeError with the end of its log."""
    environment = {
        **os.environ,
        "OMP_NUM_THREADS": "1",  # members run side by side
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    done = subprocess.run([CODE], cwd=folder, env=environment, capture_output=True, text=True, check=False)
    log = folder / "clover.out"
    text = log.read_text() if log.is_file() else ""
    if done.returncode or "Calculation complete" not in text:
        raise RuntimeError(f"CloverLeaf3D did not finish: {(text + done.stderr)[-600:]}")


def last_dump(folder: Path) -> Path:
    """The file that the code wrote last: one is of the start."""
    return max(folder.glob("clover.*.vtk"), key=lambda path: int(NAME.fullmatch(path.name)["step"]))  # type: ignore[index]
