"""Blocks that fill no grid as they are (refined, overlapping, beside one another's samples), resampled onto one."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insitu.mpi.layout import BlockExtent, BlockLayout
from insitu.mpi.neighbours import BlockSamples
from insitu.mpi.ranks import RankGroup
from render.blocks import Lattice
from render.partition import Index, Piece

MOST_SAMPLES = 1024  # per axis
FACE = 1e-6  # samples by which a place may lie outside of a block and still count as on its face


@dataclass(frozen=True, eq=False)
class Contribution:
    """A block's values (nz, ny, nx) for a box of samples from `start` on, NaN where it has none.

    Of several for one sample the one with the largest `rank` counts: (is it no ghost layer, fineness).
    """

    rank: tuple[bool, float]
    start: Index
    values: NDArray[np.float64]


def common_lattice(extents: Sequence[BlockExtent | None]) -> Lattice:
    """The lattice over all blocks, as fine as the finest of them along each axis, but for `MOST_SAMPLES`."""
    blocks = [extent for extent in extents if extent is not None]
    low = np.min([extent.origin for extent in blocks], axis=0)  # [3] x, y, z
    high = np.max([end(extent) for extent in blocks], axis=0)
    finest = np.min([extent.spacing for extent in blocks], axis=0)
    counts = np.clip(np.ceil((high - low) / finest - FACE).astype(np.int64) + 1, 2, MOST_SAMPLES)
    x, y, z = counts.tolist()
    step, origin = ((high - low) / (counts - 1)).tolist(), low.tolist()
    return Lattice((z, y, x), (step[0], step[1], step[2]), (origin[0], origin[1], origin[2]))


def end(extent: BlockExtent) -> NDArray[np.float64]:
    """Place (3,), x, y, z, of the last sample."""
    return np.array(extent.origin) + np.array(extent.spacing) * (np.array(extent.shape[::-1]) - 1)


def even_layout(whole: Lattice, count: int) -> BlockLayout:
    """A box for each of `count` ranks, as even as can be; None for some where there are fewer samples."""
    owned: list[Piece | None] = [None] * count
    for rank, piece in enumerate(_halved(Piece(0, (0, 0, 0), whole.shape), count)):
        owned[rank] = Piece(rank, piece.start, piece.stop)
    return BlockLayout(whole, tuple(owned))


def resampled(
    samples: BlockSamples | None, extents: Sequence[BlockExtent], laid: BlockLayout, ranks: RankGroup
) -> tuple[BlockSamples | None, int]:
    """This rank's box of `laid`, trilinear between the samples of all blocks, and how many samples of it none covers.  Collective.

    `samples` lie at the first of `extents`, ghost layers included, and are the rank's own within the second.  Of blocks that
    cover a sample the finest counts, and what one owns before ghost layers.
    """
    messages: list[list[Contribution]] = [[] for _ in range(ranks.size)]
    if samples is not None:
        values = np.where(False if samples.holes is None else samples.holes, np.nan, samples.values.astype(np.float64))
        for number, piece in enumerate(laid.owned):
            if piece is not None:
                messages[number] = list(_contributions(values, extents, piece, laid.whole))
    parts = [np.frombuffer(pickle.dumps(message), dtype=np.uint8) for message in messages]
    received: list[Contribution] = [c for part in ranks.send(parts) for c in pickle.loads(part.tobytes())]
    mine = laid.owned[ranks.number]
    if mine is None:
        return None, 0
    merged = np.full(tuple(np.subtract(mine.stop, mine.start).tolist()), np.nan)
    for contribution in sorted(received, key=lambda c: c.rank):
        low = np.subtract(contribution.start, mine.start)
        box = tuple(map(slice, low.tolist(), (low + contribution.values.shape).tolist()))
        merged[box] = np.where(np.isnan(contribution.values), merged[box], contribution.values)
    holes = np.isnan(merged)
    return BlockSamples(np.where(holes, 0.0, merged), holes if holes.any() else None), int(holes.sum())


def _contributions(
    values: NDArray[np.float64], extents: Sequence[BlockExtent], piece: Piece, whole: Lattice
) -> Iterator[Contribution]:
    ghosted, own = extents
    for extent, is_own in ((ghosted, False), (own, True)) if ghosted != own else ((own, True),):
        boxes = [_covered(extent, piece, whole, axis) for axis in range(3)]
        if all(low < high for low, high in boxes):
            places = [
                np.arange(low, high) * whole.spacing[2 - a] + whole.origin[2 - a] for a, (low, high) in enumerate(boxes)
            ]
            indices = [(p - ghosted.origin[2 - a]) / ghosted.spacing[2 - a] for a, p in enumerate(places)]
            start = (boxes[0][0], boxes[1][0], boxes[2][0])
            yield Contribution((is_own, -float(np.prod(ghosted.spacing))), start, interpolated(values, indices))


def _covered(extent: BlockExtent, piece: Piece, whole: Lattice, axis: int) -> tuple[int, int]:
    """First sample of a piece along an axis (0 is z) that lies in an extent, and the one after the last."""
    low, high = extent.origin[2 - axis], end(extent)[2 - axis]
    slack = FACE * extent.spacing[2 - axis]
    first = np.ceil((low - slack - whole.origin[2 - axis]) / whole.spacing[2 - axis])
    last = np.floor((high + slack - whole.origin[2 - axis]) / whole.spacing[2 - axis])
    return max(int(first), piece.start[axis]), min(int(last) + 1, piece.stop[axis])


def interpolated(values: NDArray[np.float64], indices: Sequence[NDArray[np.floating]]) -> NDArray[np.float64]:
    """Trilinear values at all combinations of fractional indices along each axis; NaN next to NaN."""
    for axis, index in enumerate(indices):
        inside = np.clip(index, 0.0, values.shape[axis] - 1.0)
        low = np.floor(inside).astype(np.int64)
        high = np.minimum(low + 1, values.shape[axis] - 1)
        share = (inside - low).reshape([-1 if a == axis else 1 for a in range(3)])
        first: NDArray[Any] = np.take(values, low, axis=axis)
        values = np.where(share > FACE, first + share * (np.take(values, high, axis=axis) - first), first)
    return values


def _halved(piece: Piece, count: int) -> list[Piece]:
    """Up to `count` boxes that fill a piece, cut along the longest axis again and again."""
    lengths = np.subtract(piece.stop, piece.start)
    axis = int(np.argmax(lengths))
    if count == 1 or lengths[axis] == 1:
        return [piece]
    less = count // 2
    share = round(int(lengths[axis]) * less / count)
    plane = piece.start[axis] + min(max(share, 1), int(lengths[axis]) - 1)
    first, second = piece.cut(axis, plane)
    return _halved(first, less) + _halved(second, count - less)
