"""The change of a field's colours from sample to sample, which decides how far apart samples along a ray may lie."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from render.grids import Grid, Triple

CELLS = 10_000  # looked at in a field, however large
SAMPLES = 48  # of the swept field, along each axis
SWEPT_IN = 8  # samples


def mean_change(grid: Grid, transfer: TransferFunction) -> float:
    """Root-mean-square change of premultiplied colour and opacity between neighbouring samples, holes left out.

    Over at most `CELLS` grid cells, drawn at random and always the same, so that it costs the same for any grid.
    """
    return root_mean_square(squared_changes(grid, transfer, drawn_cells(grid.shape)))


def drawn_cells(shape: tuple[int, int, int]) -> NDArray[np.int64]:
    """First samples (N, 3), z, y, x, of the cells that `mean_change` looks at in a grid of this shape."""
    cells = np.array(shape) - 1
    count = int(cells.prod())
    numbers = np.arange(count) if count <= CELLS else np.random.default_rng(0).integers(0, count, CELLS)
    return np.stack(np.unravel_index(numbers, tuple(cells)), axis=1)


def squared_changes(grid: Grid, transfer: TransferFunction, first: NDArray[np.int64]) -> NDArray[np.float64]:
    """Squares (M,) of the changes of premultiplied RGBA from samples `first` (N, 3) to the next along each axis."""
    if grid.holes is not None:
        first = first[~grid.holes[tuple(first.T)]]

    def premultiplied(places: NDArray[np.int64]) -> NDArray[np.float64]:
        values = grid.values[tuple(places.T)]
        opacities = transfer.opacities(values)[:, None]  # [N, 1]
        return np.concatenate([transfer.colors(values) * opacities, opacities], axis=1)  # [N, 4]

    here, squares = premultiplied(first), []
    for step in np.eye(3, dtype=np.int64):
        valid = np.ones(len(first), dtype=bool) if grid.holes is None else ~grid.holes[tuple((first + step).T)]
        squares.append(((premultiplied(first + step) - here)[valid] ** 2).ravel())
    return np.concatenate(squares)


def root_mean_square(squares: NDArray[np.float64]) -> float:
    """Of changes; 0 of none."""
    return float(np.sqrt(squares.mean())) if squares.size else 0.0


def swept(spacing: Triple, transfer: TransferFunction) -> Grid:
    """A field that shows all of a transfer function: shells that sweep its range in `SWEPT_IN` samples."""
    low, high = transfer.bounds
    axis = np.arange(SAMPLES) - (SAMPLES - 1) / 2
    radius = np.sqrt(axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2)  # in samples
    return Grid(low + (high - low) * (0.5 - 0.5 * np.cos(np.pi * radius / SWEPT_IN)), spacing)
