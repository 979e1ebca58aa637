"""AMReX plotfiles (Nyx, Castro, WarpX, ...): levels merged a slab at a time, once their headers are checked.

Written here rather than taken from a library: the checked headers say where each box's numbers lie, and need only be copied.  VTK's
reader crashes on edited headers and gives no merged grid; yt brings 121 MB, and merges levels wrongly whose cells are not
numbered from 0.

Cells are values at their centres.  A cell of a coarse level that no finer one covers is repeated; one that is covered holds what
the code stored there, the mean of the finer ones.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insitu.fields.field import Field
from insitu.readers.amrex_header import Plotfile, RefinementLevel, is_plotfile, read_plotfile, read_summary
from insitu.readers.arrays import check_room
from insitu.readers.reader import Reader, Sampling, StoredState, chosen_array

SLAB = 1 << 26  # bytes of double precision that are merged at a time
SCALE_FACTOR = "comoving_a"  # Nyx's file of the cosmological scale factor


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """The one state in a plotfile: its redshift, where the job says it, and its time."""
    time, factor = read_summary(path).time, path / SCALE_FACTOR
    return [StoredState((), {**({"redshift": _redshift(factor)} if factor.is_file() else {}), "time": time})]


def read(path: Path, array: str | None, index: tuple[int, ...], sampling: Sampling) -> Field:
    """A field on the cells of the finest level, or as many as `sampling` asks for."""
    plotfile = read_plotfile(path)
    name = chosen_array(array, plotfile.names, "the plotfile")
    number, factors = _level(plotfile, sampling.resolution)
    counts = [n // k for n, k in zip(plotfile.levels[number].counts, factors, strict=True)]  # x, y, z
    try:
        check_room(plotfile.kind.itemsize * math.prod(counts) + SLAB, f"level {number} of {counts} cells")
    except ValueError as error:
        raise ValueError(f"{error}: ask for fewer by --resolution") from None
    values = np.empty(counts[::-1], dtype=plotfile.kind.newbyteorder("="))  # [nz, ny, nx]
    _merge(plotfile, name, number, factors, values)
    spacing = [(b - a) / n for a, b, n in zip(plotfile.low, plotfile.high, counts, strict=True)]
    x, y, z = spacing
    i, j, k = (a + step / 2 for a, step in zip(plotfile.low, spacing, strict=True))
    return Field(values, (x, y, z), (i, j, k), name, time=plotfile.time)


def _level(plotfile: Plotfile, resolution: tuple[int, int, int] | None) -> tuple[int, tuple[int, int, int]]:
    """The coarsest level that has the cells of `resolution` or whole multiples of them, and these multiples along x, y and z."""
    if resolution is None:
        return len(plotfile.levels) - 1, (1, 1, 1)
    for number, level in enumerate(plotfile.levels):
        if all(n % wanted == 0 for n, wanted in zip(level.counts, resolution, strict=True)):
            x, y, z = (n // wanted for n, wanted in zip(level.counts, resolution, strict=True))
            return number, (x, y, z)
    counts = ", ".join(" ".join(map(str, level.counts)) for level in plotfile.levels)
    raise ValueError(
        f"resolution {' '.join(map(str, resolution))} must divide the cells of a level, of which there are {counts}"
    )


def _merge(
    plotfile: Plotfile, name: str, number: int, factors: tuple[int, int, int], values: NDArray[np.floating]
) -> None:
    """Fill `values` [nz, ny, nx] with means over `factors` cells (x, y, z) of a level, a slab of planes at a time."""
    level, component = plotfile.levels[number], plotfile.names.index(name)
    nx, ny, nz = level.counts
    kx, ky, kz = factors
    thickness = kz * max(1, SLAB // (8 * nx * ny * kz))
    for begin in range(0, nz, thickness):
        slab = np.empty((min(thickness, nz - begin), ny, nx), dtype=values.dtype)
        for coarser in plotfile.levels[: number + 1]:  # the finest last, whose cells count
            _paste(plotfile, coarser, level, component, begin, slab)
        if factors != (1, 1, 1):
            blocks = slab.reshape(len(slab) // kz, kz, ny // ky, ky, nx // kx, kx)
            slab = blocks.mean(axis=(1, 3, 5), dtype=np.float64)
        values[begin // kz : begin // kz + len(slab)] = slab


def _paste(
    plotfile: Plotfile,
    coarser: RefinementLevel,
    level: RefinementLevel,
    component: int,
    begin: int,
    slab: NDArray[np.floating],
) -> None:
    """Copy cells of a coarser level, or of the level itself, repeated, into a slab [z, y, x] of the level from plane `begin` on."""
    ratio = np.array(level.counts) // coarser.counts  # [3] x, y, z
    first = coarser.boxes[:, 0] - coarser.low  # [B, 3]
    low, high = first * ratio, (coarser.boxes[:, 1] - coarser.low + 1) * ratio
    within = (low[:, 2] < begin + len(slab)) & (high[:, 2] > begin)
    for box in np.flatnonzero(within):
        bottom, top = max(low[box, 2], begin), min(high[box, 2], begin + len(slab))
        planes = np.arange(bottom, top) // ratio[2] - first[box, 2]  # of the box, one for each of the slab's
        cells = plotfile.planes(coarser, int(box), component, int(planes[0]), int(planes[-1]) + 1)
        repeated = cells[planes - planes[0]].repeat(ratio[1], axis=1).repeat(ratio[0], axis=2)
        slab[bottom - begin : top - begin, low[box, 1] : high[box, 1], low[box, 0] : high[box, 0]] = repeated


def _redshift(path: Path) -> float:
    """The redshift 1 / a - 1 of the scale factor in a file."""
    with path.open("rb") as file:
        word = file.readline(100).decode("latin-1").strip()
    try:
        factor = float(word)
    except ValueError:
        factor = math.nan
    if not (math.isfinite(factor) and factor > 0):
        raise ValueError(f"{path.name} must hold the scale factor, a positive number, got {word[:40]!r}")
    return 1 / factor - 1


READER = Reader(
    "amrex", "AMReX plotfiles, plt<step>", is_plotfile, records, read, marks=("Header", "Level_0"), samples=True
)
