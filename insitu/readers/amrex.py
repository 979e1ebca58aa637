"""AMReX plotfiles (Nyx, Castro, WarpX, ...): levels merged a slab at a time, once their headers are checked.

Written here rather than taken from a library: the checked headers say where each box's numbers lie, and need only be copied.  VTK's
reader crashes on edited headers and gives no merged grid; yt brings 121 MB, and merges levels wrongly whose cells are not
numbered from 0.

Cells are values at their centres.  A cell of a coarse level that no finer one covers is repeated; one that is covered holds what
the code stored there, the mean of the finer ones.  Cells behind an embedded boundary are NaN.  The extremes of each box that is
read must be those in its header: nothing else shows that numbers are damaged.
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
COVERED = 1e30  # the least number that stands for a cell without fluid
SHARES = {"vfrac", "volfrac"}  # the component that says how much of a cell is not behind an embedded boundary
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
    level, cells = plotfile.levels[number], PlotfileComponent(plotfile, plotfile.names.index(name))
    shares = next((i for i, other in enumerate(plotfile.names) if other.lower() in SHARES and other != name), None)
    shared = None if shares is None else PlotfileComponent(plotfile, shares)
    (nx, ny, nz), kz = level.counts, factors[2]
    thickness = kz * max(1, SLAB // (8 * nx * ny * kz))
    for begin in range(0, nz, thickness):
        slab = np.empty((min(thickness, nz - begin), ny, nx), dtype=values.dtype)
        cells.fill(slab, level, number, begin)
        covered = _covered(slab) if cells.largest >= COVERED else None
        if shared is not None:
            share = np.empty_like(slab)
            shared.fill(share, level, number, begin)
            covered = share == 0 if covered is None else covered | (share == 0)
        covered = covered if covered is not None and covered.any() else None
        if covered is not None:
            slab[covered] = np.nan
        if factors != (1, 1, 1):
            slab = _means(slab, covered, factors)
        values[begin // kz : begin // kz + len(slab)] = slab
    cells.check()
    if shared is not None:
        shared.check()


def _covered(slab: NDArray[np.floating]) -> NDArray[np.bool_]:
    """The cells that hold a power of ten so large that codes write it where there is no fluid, such as 1e30."""
    large = (np.abs(slab) >= COVERED) & np.isfinite(slab)
    powers = np.unique(np.abs(slab[large]))
    return large & np.isin(np.abs(slab), [value for value in powers if value == slab.dtype.type(f"{value:.0e}")])


def _means(
    slab: NDArray[np.floating], covered: NDArray[np.bool_] | None, factors: tuple[int, int, int]
) -> NDArray[np.floating]:
    """Means over blocks of `factors` cells (x, y, z), of those that are not covered; NaN where all are."""
    kx, ky, kz = factors
    nz, ny, nx = slab.shape
    shape = (nz // kz, kz, ny // ky, ky, nx // kx, kx)
    if covered is None:
        return slab.reshape(shape).mean(axis=(1, 3, 5), dtype=np.float64)
    total = np.where(covered, 0, slab).reshape(shape).sum(axis=(1, 3, 5), dtype=np.float64)
    counts = (~covered).reshape(shape).sum(axis=(1, 3, 5))
    return np.divide(total, counts, out=np.full(total.shape, np.nan), where=counts > 0)


class PlotfileComponent:
    """A component of a plotfile, slab by slab.  `largest` is the absolute value of what has been read."""

    def __init__(self, plotfile: Plotfile, number: int) -> None:
        self.plotfile, self.number, self.largest = plotfile, number, 0.0
        self._extremes: dict[tuple[int, int], tuple[np.floating, np.floating, bool]] = {}  # extremes by level and box

    def fill(self, slab: NDArray[np.floating], level: RefinementLevel, number: int, begin: int) -> None:
        """Copy the cells of level `number` and of those below it into a slab [z, y, x], planes from `begin` on."""
        for coarser in range(number + 1):  # the finest last, whose cells count
            self._paste(coarser, level, begin, slab)

    def _paste(self, number: int, level: RefinementLevel, begin: int, slab: NDArray[np.floating]) -> None:
        """Copy cells of a coarser level, or of the level itself, repeated."""
        coarser = self.plotfile.levels[number]
        ratio = np.array(level.counts) // coarser.counts  # [3] x, y, z
        first = coarser.boxes[:, 0] - coarser.low  # [B, 3]
        low, high = first * ratio, (coarser.boxes[:, 1] - coarser.low + 1) * ratio
        within = (low[:, 2] < begin + len(slab)) & (high[:, 2] > begin)
        for box in np.flatnonzero(within):
            bottom, top = max(low[box, 2], begin), min(high[box, 2], begin + len(slab))
            planes = np.arange(bottom, top) // ratio[2] - first[box, 2]  # of the box, one for each of the slab's
            cells = self.plotfile.planes(coarser, int(box), self.number, int(planes[0]), int(planes[-1]) + 1)
            self._note(number, int(box), cells)
            if ratio.max() > 1:
                cells = cells[planes - planes[0]].repeat(ratio[1], axis=1).repeat(ratio[0], axis=2)
            slab[bottom - begin : top - begin, low[box, 1] : high[box, 1], low[box, 0] : high[box, 0]] = cells

    def _note(self, number: int, box: int, cells: NDArray[np.floating]) -> None:
        """Note the extremes of some planes of a box."""
        least, most = cells.min(), cells.max()
        if has_nan := bool(np.isnan(least)):
            least, most = np.fmin.reduce(cells, axis=None), np.fmax.reduce(cells, axis=None)
        if (number, box) in self._extremes:
            a, b, other = self._extremes[number, box]
            least, most, has_nan = np.fmin(a, least), np.fmax(b, most), has_nan or other
        self._extremes[number, box] = least, most, has_nan
        self.largest = max(self.largest, abs(float(least)), abs(float(most)))

    def check(self) -> None:
        """Raise ValueError where a box that was read has other extremes than its header prints."""
        for (number, box), (least, most, has_nan) in self._extremes.items():
            self.plotfile.levels[number].check_extremes(box, self.number, (least, most), has_nan)


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
