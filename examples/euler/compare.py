"""Compare PyClaw's solutions with CloverLeaf3D's own, of a folder of real data that is not part of this repository.

    .venv-euler/bin/python examples/euler/compare.py [--cells 32 64 96]

$GS_SURROGATE_DATA names the folder (default `../shared/data`).  It has `clover.00001.00040.vtk.gz`, the code's dump of density
and energy, and `cloverleaf3d_energy_64.h5`, the energy of 120 members and their parameters.  The dump is of the first member.
Both codes have 64³ cells there.  On other numbers of cells the finer field is averaged, or interpolated between centres of cells.
Prints a table.
"""

from __future__ import annotations

import argparse
import os
import sys
import time as clock
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

sys.path.insert(0, str(Path(__file__).parent))
from simulation import solve

from insitu.readers.cloverleaf import read
from insitu.readers.reader import Sampling

PROJECT = Path(__file__).resolve().parents[2]
ENSEMBLE, DUMP = "cloverleaf3d_energy_64.h5", "clover.00001.00040.vtk.gz"
MEMBERS = (0, 40, 110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, nargs="+", default=[32, 64, 96], help="along each axis of PyClaw's grid")
    arguments = parser.parse_args()
    folder = Path(os.environ.get("GS_SURROGATE_DATA", PROJECT.parent / "shared" / "data"))
    if not (folder / ENSEMBLE).is_file() or not (folder / DUMP).is_file():
        raise SystemExit(f"{folder} lacks {ENSEMBLE} or {DUMP}: set GS_SURROGATE_DATA to the folder that holds them")
    with h5py.File(folder / ENSEMBLE) as file:
        names = [name if isinstance(name, str) else name.decode() for name in file.attrs["names"]]
        rows, time = file["params"][list(MEMBERS)], float(file.attrs["time"])
        energies = file["field"][list(MEMBERS)].astype(float)  # [member, z, y, x]
    density = np.asarray(read(folder / DUMP, "density", (), Sampling()).values, float)
    print("| member | cells | correlation of density | of energy | relative L2 error of energy | processor s |")
    print("| --- | --- | --- | --- | --- | --- |")
    for member, row, energy in zip(MEMBERS, rows, energies, strict=True):
        for cells in arguments.cells:
            started = clock.process_time()
            ours = [like(found, energy.shape[0]) for found in solve(dict(zip(names, row, strict=True)), cells, time)]
            seconds = clock.process_time() - started
            of_density = f"{correlation(ours[0], density):.4f}" if member == 0 else "–"
            error = np.linalg.norm(ours[1] - energy) / np.linalg.norm(energy)
            print(
                f"| {member} | {cells}³ | {of_density} | {correlation(ours[1], energy):.4f} | {error:.3f} | {seconds:.1f} |",
                flush=True,
            )


def like(values: NDArray[np.float64], cells: int) -> NDArray[np.float64]:
    """A field of cell values on another number of cells."""
    if values.shape[0] % cells == 0:
        step = values.shape[0] // cells
        return values.reshape(cells, step, cells, step, cells, step).mean(axis=(1, 3, 5))
    return zoom(values, cells / values.shape[0], order=1, mode="nearest", grid_mode=True)


def correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


if __name__ == "__main__":
    main()
