"""Layouts of blocks on a grid, against blocks that were cut from one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insitu.mpi.layout import BlockExtent, UnevenBlocks, layout
from render.blocks import Lattice
from tests.support.decomposed import kd_boxes

SPACING, ORIGIN = (0.1, 0.25, 3.0), (-4.0, 1e4, 7.0)


def extents_of(pieces, shared):
    """The extents of pieces of one lattice, the neighbours' first layers along the axes that are `shared` among them."""
    whole = Lattice((1, 1, 1), SPACING, ORIGIN)
    shapes = [tuple((np.subtract(p.stop, p.start) + shared).tolist()) for p in pieces]
    return [BlockExtent(shape, SPACING, whole.place(p.start)) for p, shape in zip(pieces, shapes, strict=True)]


@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 12),
    shared=st.tuples(*[st.integers(0, 1)] * 3),
    single=st.booleans(),
)
@settings(max_examples=80, deadline=None)
def test_blocks_that_were_cut_from_a_grid_fill_it_again(seed, count, shared, single) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(6, 30, 3).tolist())
    boxes = kd_boxes(tuple(np.subtract(shape, shared).tolist()), count, rng)  # of cells along axes that are shared
    extents = extents_of(boxes, shared)
    if single:  # coordinates in single precision
        extents = [replace(e, origin=tuple(map(float, np.float32(e.origin)))) for e in extents]
    order = rng.permutation(count)
    laid = layout([None, *(extents[i] for i in order), None])
    assert laid.whole.shape == shape
    np.testing.assert_allclose(laid.whole.spacing, SPACING)
    np.testing.assert_allclose(laid.whole.origin, ORIGIN, atol=1e-3)
    assert (laid.owned[0], laid.owned[-1]) == (None, None)
    for rank, i in enumerate(order, start=1):
        piece = laid.owned[rank]
        assert piece is not None
        assert piece.owner == rank
        at_end = (np.array(boxes[i].stop) + shared == shape) * np.array(shared)
        assert piece.start == boxes[i].start
        assert piece.stop == tuple((np.array(boxes[i].stop) + at_end).tolist())


BLOCK = BlockExtent((4, 4, 4), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (BlockExtent((4, 4, 4), (1.0, 1.0, 0.5), (4.0, 0.0, 0.0)), r"rank 0 has the spacing \(1.0, 1.0, 1.0\), rank 1"),
        (
            BlockExtent((4, 4, 4), (1.0, 1.0, 1.0), (4.5, 0.0, 0.0)),
            r"rank 1, at \(4.5, 0.0, 0.0\), lies between samples",
        ),
        (BlockExtent((4, 4, 4), (1.0, 1.0, 1.0), (2.0, 0.0, 0.0)), "the blocks of ranks 0 and 1 overlap"),
        (BlockExtent((4, 4, 5), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)), "the blocks of ranks 0 and 1 overlap"),
        (BlockExtent((4, 4, 4), (1.0, 1.0, 1.0), (6.0, 0.0, 0.0)), "leave 32 of the 10 x 4 x 4 samples"),
        (BlockExtent((4, 3, 4), (1.0, 1.0, 1.0), (4.0, 0.0, 0.0)), "leave 16 of the 8 x 4 x 4 samples"),
    ],
)
def test_blocks_that_fill_no_grid_say_why(other, message) -> None:
    with pytest.raises(UnevenBlocks, match=message):
        layout([BLOCK, other])


def test_a_single_layer_may_be_a_block() -> None:
    laid = layout([BLOCK, BlockExtent((1, 4, 4), (1.0, 1.0, 1.0), (0.0, 0.0, 4.0))])
    assert laid.whole.shape == (5, 4, 4)


def test_blocks_without_their_origins_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"ranks 0 and 1 lie at the same place, 4 x 4 x 4 samples .* pass with each block"
    ):
        layout([BLOCK, BLOCK])
