"""AMReX plotfiles (Nyx, Castro, WarpX, ...): levels merged by yt, a slab at a time, once their headers are checked.

Cells are values at their centres.  A cell of a coarse level that no finer one covers is repeated; one that is covered holds what
the code stored there, the mean of the finer ones.
"""

from __future__ import annotations

import gc
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insitu.fields.field import Field
from insitu.readers.amrex_header import Plotfile, RefinementLevel, is_plotfile, read_plotfile, read_summary
from insitu.readers.arrays import check_room
from insitu.readers.reader import Reader, Sampling, StoredState, chosen_array

SLAB = 1 << 26  # bytes of double precision that yt merges at a time
SCALE_FACTOR = "comoving_a"  # Nyx's file of the cosmological scale factor
YT = "reading AMReX plotfiles takes yt: pip install 'gs-surrogate[amrex]'"


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """The one state in a plotfile: its redshift, where the job says it, and its time."""
    time, factor = read_summary(path).time, path / SCALE_FACTOR
    return [StoredState((), {**({"redshift": _redshift(factor)} if factor.is_file() else {}), "time": time})]


def read(path: Path, array: str | None, index: tuple[int, ...], sampling: Sampling) -> Field:
    """A field on the cells of the finest level, or as many as `sampling` asks for."""
    plotfile = read_plotfile(path)
    name = chosen_array(array, plotfile.names, "the plotfile")
    number, factors = _level(plotfile, sampling.resolution)
    level = plotfile.levels[number]
    if number and any(level.low):
        raise ValueError(
            f"its cells are numbered from {level.low} and not from 0, of which yt merges several levels wrongly"
        )
    counts = [n // k for n, k in zip(level.counts, factors, strict=True)]  # x, y, z
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
    """The coarsest level that has so many cells or whole multiples of them, and these multiples along x, y and z."""
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
    """Fill `values` [nz, ny, nx] with means over `factors` cells (x, y, z) of a level."""
    dataset = _dataset(plotfile.path)
    level = plotfile.levels[number]
    nx, ny, nz = level.counts
    kx, ky, kz = factors
    thickness = _thickness(level, kz)
    width = (plotfile.high[2] - plotfile.low[2]) / nz
    for begin in range(0, nz, thickness):
        first = min(begin, nz - thickness)  # yt takes a slab of one cell for the whole domain
        corner = [*plotfile.low[:2], plotfile.low[2] + first * width]
        grid = dataset.covering_grid(number, left_edge=corner, dims=[nx, ny, thickness])
        held: NDArray[Any] = grid["boxlib", name].d.T  # [slab, ny, nx]
        if factors != (1, 1, 1):
            held = held.reshape(thickness // kz, kz, ny // ky, ky, nx // kx, kx).mean(axis=(1, 3, 5))
        values[first // kz : (first + thickness) // kz] = held
        del grid, held
    del dataset
    gc.collect()  # yt's data sets refer to themselves, and would pile up


def _thickness(level: RefinementLevel, factor: int) -> int:
    """Cells along z that are merged at a time, at least 2: whole boxes, so that each is read once, if memory allows."""
    nx, ny, nz = level.counts
    boxes, room = int((level.boxes[:, 1, 2] - level.boxes[:, 0, 2] + 1).max()), SLAB // (8 * nx * ny)
    wanted = max(2, room // boxes * boxes or room)
    return min(nz, -(-wanted // factor) * factor)


def _dataset(path: Path) -> Any:
    try:
        import yt
        from yt.frontends.amrex.api import BoxlibDataset
    except ModuleNotFoundError:
        raise ModuleNotFoundError(YT) from None
    yt.set_log_level("error")
    # The class that all codes share, and no file of parameters: what those say was read above, and those of a code would be
    # looked for outside the plotfile as well.
    return BoxlibDataset(str(path), cparam_filename="/dev/null")


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


READER = Reader("amrex", "AMReX plotfiles, plt<step>", is_plotfile, records, read, samples=True)
