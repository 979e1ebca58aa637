"""A simulation on several ranks of MPI, its field in slabs: heat that spreads from hot spots, over diffusivity and time.

mpiexec -n 4 python -m mpi4py examples/ranks.py          # pip install 'gs-surrogate[all,mpi]' mpich
surrogate train heat.cdb --hold-out 0.2
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import insitu

PLAN: dict[str, Any] = {
    "space": {"diffusivity": (0.2, 1.0), "time": (0.0, 60.0)},
    "appearances": insitu.VolumeRendering(
        "heat",
        insitu.TransferFunction(
            color_points=((0.0, 0.1, 0.2, 0.8), (0.3, 0.9, 0.8, 0.3), (1.0, 0.8, 0.1, 0.1)),  # value, red, green, blue
            opacity_points=((0.1, 0.0), (0.3, 0.3), (1.0, 0.9)),
            opacity_unit_distance=4.0,
        ),
    ),
    "fields": {"temperature": "1"},
}
SPOTS = ((0.3, 0.3, 0.3), (0.6, 0.7, 0.5), (0.4, 0.5, 0.8))  # z, y, x, in sides of the box


def spread(comm: Any, size: int, diffusivity: float, times: range) -> Iterator[tuple[int, NDArray[np.float64], int]]:
    """(time, this rank's slab with a ghost layer on either side along z, index of its first sample) at each of `times`.

    Explicit steps of the heat equation; periodic, samples and steps of 1.
    """
    first, after = size * comm.rank // comm.size, size * (comm.rank + 1) // comm.size
    z, y, x = np.meshgrid(np.arange(first - 1, after + 1), *[np.arange(size)] * 2, indexing="ij")
    heat = np.zeros(z.shape)
    for spot in SPOTS:
        heat += np.exp(-sum((axis / size - place) ** 2 for axis, place in zip((z, y, x), spot, strict=True)) / 0.02)
    below, above = (comm.rank - 1) % comm.size, (comm.rank + 1) % comm.size
    for time in range(max(times) + 1):
        heat[0] = comm.sendrecv(heat[-2], dest=above, source=below)
        heat[-1] = comm.sendrecv(heat[1], dest=below, source=above)
        if time in times:
            yield time, heat, first - 1
        around = heat[:-2] + heat[2:] - 6 * heat[1:-1]
        around += sum(np.roll(heat[1:-1], shift, axis) for axis in (1, 2) for shift in (-1, 1))
        heat[1:-1] += diffusivity / 6 * around


def main(catalog: Path, size: int = 48, **options: Any) -> None:
    """Render the ensemble, going on where it was interrupted."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    with insitu.Session(catalog, comm=comm, existing="skip", **PLAN, **options) as session:
        for diffusivity in (0.2, 0.4, 0.6, 0.8, 1.0):
            for time, slab, first in spread(comm, size, diffusivity, range(0, 61, 20)):
                place = {"spacing": (1.0, 1.0, 1.0), "origin": (0.0, 0.0, float(first)), "ghosts": (0, 0, 1)}
                session.render_member(slab, {"diffusivity": diffusivity}, time=time, **place)
        if comm.rank == 0:
            print(f"{len(session.results)} members rendered into {catalog}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "heat.cdb"))
