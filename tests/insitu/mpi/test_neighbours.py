"""Layers that blocks exchange, against slices of the whole."""

from __future__ import annotations

import numpy as np
import pytest

from insitu.mpi.layout import BlockExtent, layout
from insitu.mpi.neighbours import BlockSamples, block_of
from render.datasets import to_grid
from render.volume import hidden_cells
from tests.support.decomposed import kd_boxes
from tests.support.mpi import on_ranks


def extent(piece) -> BlockExtent:
    return BlockExtent(
        tuple(np.subtract(piece.stop, piece.start).tolist()), (1.0, 1.0, 1.0), tuple(map(float, piece.start[::-1]))
    )


def blocks(values, pieces, holes=None, types=None):
    laid = layout([None if p is None else extent(p) for p in pieces])

    def work(ranks):
        piece = pieces[ranks.number]
        if piece is None:
            return block_of(None, laid, ranks)
        part = tuple(map(slice, piece.start, piece.stop))
        dtype = values.dtype if types is None else types[ranks.number]
        hidden = None if holes is None or not holes[part].any() else holes[part]
        return block_of(BlockSamples(values[part].astype(dtype), hidden), laid, ranks)

    return on_ranks(len(pieces), work)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_every_block_has_its_neighbours_samples(count) -> None:
    rng = np.random.default_rng(count)
    values = rng.normal(size=(13, 17, 11))
    pieces = [*kd_boxes(values.shape, count, rng), None]
    *found, none = blocks(values, pieces)
    assert none is None
    for block, piece in zip(found, pieces, strict=False):
        low = np.maximum(np.array(piece.start) - 1, 0)
        high = np.minimum(np.array(piece.stop) + 2, values.shape)
        np.testing.assert_array_equal(block.grid.values, values[tuple(map(slice, low, high))])
        assert block.first == tuple(low)
        assert block.grid.origin == tuple(map(float, low[::-1]))


def test_holes_are_filled_as_in_the_whole_where_it_can_be_seen() -> None:
    rng = np.random.default_rng(5)
    values = rng.normal(size=(14, 12, 15))
    values[rng.random(values.shape) < 0.1] = np.nan
    values[4:9, 3:9, 5:11] = np.nan
    grid = to_grid(values, nan="transparent")
    pieces = kd_boxes(values.shape, 6, rng)
    for block in blocks(np.nan_to_num(values), pieces, holes=np.isnan(values)):
        shape = block.grid.values.shape
        part = tuple(slice(a, a + n) for a, n in zip(block.first, shape, strict=True))
        hidden = np.zeros(shape, dtype=bool) if block.grid.holes is None else block.grid.holes
        np.testing.assert_array_equal(hidden, grid.holes[part])
        deep = np.ones(shape, dtype=bool)  # holes without a neighbour that has a value
        padded = np.pad(~grid.holes, 1)
        for offset in np.ndindex(3, 3, 3):
            near = tuple(slice(a + o, a + o + n) for a, o, n in zip(block.first, offset, shape, strict=True))
            deep &= ~padded[near]
        np.testing.assert_array_equal(block.grid.values[~deep], grid.values[part][~deep])
        if block.grid.holes is not None:
            inner = (slice(0, -1),) * 3
            np.testing.assert_array_equal(hidden_cells(block.grid.holes)[inner], hidden_cells(grid.holes)[part][inner])


def test_whole_numbers_that_single_precision_holds_on_some_ranks_stay_exact_on_all() -> None:
    values = np.arange(4 * 6 * 5, dtype=np.int64).reshape(4, 6, 5)
    values[:, 3:] += 2**60 + 1
    pieces = [*kd_boxes(values.shape, 1, np.random.default_rng(0))[0].cut(1, 3)]
    pieces = [type(p)(n, p.start, p.stop) for n, p in enumerate(pieces)]
    small, large = blocks(values, pieces, types=[np.float32, np.int64])
    np.testing.assert_array_equal(large.grid.values, values[:, 2:])
    np.testing.assert_array_equal(small.grid.values, values[:, :5])
