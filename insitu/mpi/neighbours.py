"""Samples that the blocks of several ranks get from one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.holes import continued
from insitu.mpi.layout import BlockLayout
from insitu.mpi.ranks import RankGroup
from render.blocks import ABOVE, BELOW, Block
from render.grids import Grid
from render.partition import Index, Piece

IndexBox = tuple[NDArray[np.int64], NDArray[np.int64]]  # first sample and the one after the last, (3,) z, y, x
MARGIN = 1  # samples more on every side: the values of holes come from neighbours


@dataclass(frozen=True, eq=False)
class BlockSamples:
    """One field on the samples of one rank.

    Attributes
    ----------
    values : (nz, ny, nx), finite.
    holes : (nz, ny, nx), samples without a value, or None.
    """

    values: NDArray[Any]
    holes: NDArray[np.bool_] | None = None


def block_of(samples: BlockSamples | None, laid: BlockLayout, ranks: RankGroup) -> Block | None:
    """This rank's block, its neighbours' layers around it; None where it has none.  Collective.

    `samples` begin where the rank's box does, and may reach beyond its end.
    """
    kinds = [kind for kind in ranks.gather(None if samples is None else samples.values.dtype) if kind is not None]
    has_holes = any(ranks.gather(samples is not None and samples.holes is not None))
    margin = MARGIN if has_holes else 0
    shape = np.array(laid.whole.shape)
    mine = laid.owned[ranks.number]
    values = _spread(None if samples is None else samples.values, _common(kinds), laid, margin, ranks)
    holes = _spread(_holes_of(samples), np.dtype(bool), laid, margin, ranks) if has_holes else None
    if mine is None or values is None:
        return None
    wide, narrow = reach(mine, shape, margin), reach(mine, shape, 0)
    if holes is not None and holes.any():
        values = continued(values, holes)
    inner = tuple(slice(a, b) for a, b in zip(narrow[0] - wide[0], narrow[1] - wide[0], strict=True))
    first: Index = tuple(narrow[0].tolist())
    values = np.ascontiguousarray(values[inner])
    hidden = np.ascontiguousarray(holes[inner]) if holes is not None and holes[inner].any() else None
    return Block(Grid(values, laid.whole.spacing, laid.whole.place(first), hidden), first, mine, laid.whole)


def reach(piece: Piece, shape: NDArray[np.int64], margin: int) -> IndexBox:
    """The samples that a block needs: what it owns, and the layers around it, as far as there are any."""
    low = np.maximum(np.array(piece.start) - BELOW - margin, 0)
    return low, np.minimum(np.array(piece.stop) + ABOVE + margin, shape)


def _spread(
    values: NDArray[Any] | None, dtype: np.dtype[Any], laid: BlockLayout, margin: int, ranks: RankGroup
) -> NDArray[Any] | None:
    """The samples in the reach of this rank's block, each from the rank that owns it.  Collective."""
    mine, shape = laid.owned[ranks.number], np.array(laid.whole.shape)
    parts = [np.empty(0, dtype=np.uint8)] * ranks.size
    for rank, other in enumerate(laid.owned):
        if mine is None or other is None or values is None or rank == ranks.number:
            continue
        common = _common_box((np.array(mine.start), np.array(mine.stop)), reach(other, shape, margin))
        if common is not None:
            wanted = values[_window(common, np.array(mine.start))]
            parts[rank] = np.ascontiguousarray(wanted, dtype=dtype).reshape(-1).view(np.uint8)
    received = ranks.send(parts)
    if mine is None or values is None:
        return None
    low, high = reach(mine, shape, margin)
    result = np.empty(tuple((high - low).tolist()), dtype=dtype)
    own = np.array(mine.start), np.array(mine.stop)
    result[_window(own, low)] = values[_window(own, own[0])]
    for other, data in zip(laid.owned, received, strict=True):
        if data.size and other is not None:
            common = _common_box((np.array(other.start), np.array(other.stop)), (low, high))
            assert common is not None
            result[_window(common, low)] = data.view(dtype).reshape(tuple((common[1] - common[0]).tolist()))
    return result


def _common_box(one: IndexBox, other: IndexBox) -> IndexBox | None:
    low, high = np.maximum(one[0], other[0]), np.minimum(one[1], other[1])
    return (low, high) if (low < high).all() else None


def _window(box: IndexBox, first: NDArray[np.int64]) -> tuple[slice, ...]:
    """The place of a box in an array whose first sample is `first`."""
    return tuple(map(slice, (box[0] - first).tolist(), (box[1] - first).tolist()))


def _common(kinds: Sequence[np.dtype[Any]]) -> np.dtype[Any]:
    """The type that holds the samples of all ranks: float32 stands for whole numbers that it holds exactly, too."""
    whole = [kind for kind in kinds if kind.kind in "iu"]
    return np.result_type(*(whole or kinds))


def _holes_of(samples: BlockSamples | None) -> NDArray[np.bool_] | None:
    if samples is None:
        return None
    return np.zeros(samples.values.shape, dtype=bool) if samples.holes is None else samples.holes
