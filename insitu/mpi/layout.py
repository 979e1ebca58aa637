"""The blocks of several ranks as parts of one grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from render.blocks import Lattice
from render.grids import Triple
from render.partition import Index, Piece

SAME = 1e-5  # relative difference of spacings that are one
OFF = 0.02  # samples by which a block may lie beside the lattice


@dataclass(frozen=True)
class BlockExtent:
    """The place of a rank's samples: counts along (z, y, x), spacing and place of the first in (x, y, z), world units."""

    shape: Index
    spacing: Triple
    origin: Triple


@dataclass(frozen=True)
class BlockLayout:
    """The grid that blocks fill together, and each rank's box of samples in it, None where it has none."""

    whole: Lattice
    owned: tuple[Piece | None, ...]

    @property
    def boxes(self) -> list[Piece]:
        """Those that there are."""
        return [piece for piece in self.owned if piece is not None]


class UnevenBlocks(ValueError):
    """Blocks that fill no grid as they are; the text says why."""


def layout(extents: Sequence[BlockExtent | None]) -> BlockLayout:
    """The layout of the blocks of all ranks, None of one without.

    Neighbours may both have the samples between them, along some axes or all; these belong to the one that begins with them.
    There is at least one.  Raises UnevenBlocks where they don't have one spacing, don't lie on one lattice, overlap or leave
    gaps, ValueError where two lie at the same place.
    """
    ranks = [rank for rank, extent in enumerate(extents) if extent is not None]
    blocks = [extent for extent in extents if extent is not None]
    _check_places(ranks, blocks)
    spacing = _common_spacing(ranks, blocks)
    origins = np.array([extent.origin for extent in blocks])  # [N, 3] x, y, z
    origin = origins.min(axis=0)
    starts, stops = _indices(ranks, blocks, origins, origin, spacing)
    shape = stops.max(axis=0)
    whole = Lattice(_index(shape), _triple(spacing), _triple(origin))
    stops = _filling(ranks, starts, stops, shape)
    owned: list[Piece | None] = [None] * len(extents)
    for rank, start, stop in zip(ranks, starts, stops, strict=True):
        owned[rank] = Piece(rank, _index(start), _index(stop))
    return BlockLayout(whole, tuple(owned))


def _check_places(ranks: Sequence[int], blocks: Sequence[BlockExtent]) -> None:
    first: dict[BlockExtent, int] = {}
    for rank, extent in zip(ranks, blocks, strict=True):
        if extent in first:
            x, y, z = extent.shape[::-1]
            raise ValueError(
                f"the blocks of ranks {first[extent]} and {rank} lie at the same place, {x} x {y} x {z} samples from "
                f"{extent.origin}: pass with each block the origin of its first sample"
            )
        first[extent] = rank


def _common_spacing(ranks: Sequence[int], blocks: Sequence[BlockExtent]) -> NDArray[np.float64]:
    spacings = np.array([extent.spacing for extent in blocks])  # [N, 3]
    other = (np.abs(spacings - spacings[0]) > SAME * spacings[0]).any(axis=1)
    if other.any():
        first = int(np.argmax(other))
        raise UnevenBlocks(
            f"rank {ranks[0]} has the spacing {blocks[0].spacing}, rank {ranks[first]} {blocks[first].spacing}"
        )
    result: NDArray[np.float64] = spacings.mean(axis=0)
    return result


def _indices(
    ranks: Sequence[int],
    blocks: Sequence[BlockExtent],
    origins: NDArray[np.float64],
    origin: NDArray[np.float64],
    spacing: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First sample of each block, and the one after the last, (N, 3) z, y, x, on the lattice from `origin`."""
    places = (origins - origin) / spacing  # [N, 3] x, y, z
    rounding = (
        4 * np.finfo(np.float32).eps * np.abs(origins) / spacing
    )  # coordinates that went through single precision
    off = (np.abs(places - np.rint(places)) > OFF + rounding).any(axis=1)
    if off.any():
        first = int(np.argmax(off))
        raise UnevenBlocks(
            f"the first sample of rank {ranks[first]}, at {blocks[first].origin}, lies between samples of the lattice from "
            f"{tuple(origin.tolist())} in steps of {tuple(spacing.tolist())}"
        )
    starts = np.rint(places).astype(np.int64)[:, ::-1]
    return starts, starts + np.array([extent.shape for extent in blocks])


def _filling(
    ranks: Sequence[int], starts: NDArray[np.int64], stops: NDArray[np.int64], shape: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The ends of blocks that fill all samples, each once: as they are, or without the last layers that neighbours share."""
    problems = []
    for shared in product((0, 1), repeat=3):
        trimmed = np.where((stops < shape) & (stops - starts > 1), stops - shared, stops)
        problem = _problem(ranks, starts, trimmed, shape)
        if problem is None:
            return trimmed
        problems.append(problem)
    raise UnevenBlocks(problems[0])


def _problem(
    ranks: Sequence[int], starts: NDArray[np.int64], stops: NDArray[np.int64], shape: NDArray[np.int64]
) -> str | None:
    """Why boxes don't fill all samples, each once; None where they do."""
    for block in range(len(starts)):
        common = (starts[block] < stops[block + 1 :]) & (starts[block + 1 :] < stops[block])
        overlaps = np.flatnonzero(common.all(axis=1))
        if overlaps.size:
            return f"the blocks of ranks {ranks[block]} and {ranks[block + 1 + int(overlaps[0])]} overlap"
    filled, wanted = int((stops - starts).prod(axis=1).sum()), int(shape.prod())
    x, y, z = shape[::-1].tolist()
    text = f"the blocks leave {wanted - filled} of the {x} x {y} x {z} samples between them without a value"
    return text if filled != wanted else None


def _index(numbers: NDArray[np.int64]) -> Index:
    z, y, x = map(int, numbers)
    return z, y, x


def _triple(numbers: NDArray[np.float64]) -> Triple:
    x, y, z = map(float, numbers)
    return x, y, z
