"""A block of a grid that is spread over several processes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from render.grids import Grid, Triple
from render.partition import Index, Piece

BELOW, ABOVE = 1, 2  # layers of samples around what a block owns: central differences at either end need as many


@dataclass(frozen=True)
class Lattice:
    """The place of a grid's samples.

    Attributes
    ----------
    shape : samples along (z, y, x).
    spacing, origin : world units, in the order x, y, z.
    """

    shape: Index
    spacing: Triple
    origin: Triple

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(low, high) corners (3,) of the box from the first to the last sample, world units."""
        low = np.array(self.origin)
        return low, low + np.array(self.spacing) * (np.array(self.shape[::-1]) - 1)

    def place(self, index: Index) -> Triple:
        """World position (x, y, z) of a sample (z, y, x)."""
        x, y, z = (np.array(self.origin) + np.array(self.spacing) * np.array(index[::-1])).tolist()
        return x, y, z

    def index(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Fractional index (3,), z, y, x, of a world point (3,), x, y, z."""
        fractional: NDArray[np.float64] = ((point - np.array(self.origin)) / np.array(self.spacing))[::-1]
        return fractional


@dataclass(frozen=True, eq=False)
class Block:
    """One process's part of a grid.

    Attributes
    ----------
    grid : the samples from `first` on: what the block owns, and up to `BELOW` and `ABOVE` layers of its neighbours'.
    first : index (z, y, x) in the whole of the grid's first sample.
    owned : the samples that belong to this block alone.
    whole : where all samples of the grid lie.
    """

    grid: Grid
    first: Index
    owned: Piece
    whole: Lattice


def region(whole: Lattice, piece: Piece) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(low, high) corners (3,) of the space that a piece owns, world units, x, y, z; high equals low where that is none."""
    stop = np.minimum(piece.stop, np.array(whole.shape) - 1)
    low, high = whole.place(piece.start), whole.place(tuple(stop.tolist()))
    return np.array(low), np.array(high)


def footprint(whole: Lattice, piece: Piece, camera: Camera) -> tuple[slice, slice]:
    """The rows and columns of a picture in which a piece can be seen; all of them where the camera is near it."""
    corners = np.stack(region(whole, piece))  # [2, 3]
    points = np.stack(np.meshgrid(*corners.T, indexing="ij"), axis=-1).reshape(-1, 3)  # [8, 3]
    pixels, depths = camera.project(points)  # [8, 2], [8]
    if depths.min() <= 1e-3 * np.abs(depths).max():
        return slice(0, camera.height), slice(0, camera.width)
    low = np.floor(pixels.min(axis=0) - 1.0)  # a pixel more on every side: the shader computes in single precision
    high = np.ceil(pixels.max(axis=0) + 1.0)
    left, top = np.clip(low, 0, [camera.width, camera.height]).astype(int).tolist()
    right, bottom = np.clip(high, 0, [camera.width, camera.height]).astype(int).tolist()
    return slice(top, max(top, bottom)), slice(left, max(left, right))
