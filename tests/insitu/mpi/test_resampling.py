"""Blocks of several resolutions on one grid, against a linear field, which trilinear interpolation keeps."""

from __future__ import annotations

import numpy as np
import pytest

from insitu.mpi.layout import BlockExtent
from insitu.mpi.neighbours import BlockSamples
from insitu.mpi.resampling import common_lattice, even_layout, interpolated, resampled
from render.blocks import Lattice
from tests.support.mpi import on_ranks


def linear(extent: BlockExtent):
    z, y, x = np.meshgrid(
        *(
            np.arange(n) * s + o
            for n, s, o in zip(extent.shape, extent.spacing[::-1], extent.origin[::-1], strict=True)
        ),
        indexing="ij",
    )
    return 2.0 * x - 3.0 * y + 0.5 * z + 1.0


COARSE = BlockExtent((5, 5, 5), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
FINE = BlockExtent((9, 9, 9), (0.5, 0.5, 0.5), (4.0, 0.0, 0.0))


def on_one_grid(extents, values, count=None):
    whole = common_lattice(extents)
    laid = even_layout(whole, count or len(extents))

    def work(ranks):
        held = extents[ranks.number] if ranks.number < len(extents) else None
        samples = None if held is None else BlockSamples(values[ranks.number])
        return resampled(samples, () if held is None else (held, held), laid, ranks)

    merged, holes = np.full(whole.shape, np.nan), np.zeros(whole.shape, dtype=bool)
    missing = 0
    for piece, (samples, gaps) in zip(laid.owned, on_ranks(len(laid.owned), work), strict=True):
        if piece is not None:
            box = tuple(map(slice, piece.start, piece.stop))
            merged[box], missing = samples.values, missing + gaps
            holes[box] = False if samples.holes is None else samples.holes
    return whole, merged, holes, missing


@pytest.mark.parametrize("count", [2, 3, 7])
def test_two_resolutions_side_by_side(count) -> None:
    whole, merged, _, missing = on_one_grid([COARSE, FINE], [linear(COARSE), linear(FINE)], count)
    assert missing == 0
    assert whole.shape == (9, 9, 17)
    np.testing.assert_allclose(merged, linear(BlockExtent(whole.shape, whole.spacing, whole.origin)), atol=1e-9)


def test_of_blocks_that_overlap_the_finest_counts() -> None:
    inner = BlockExtent((5, 5, 5), (0.5, 0.5, 0.5), (1.0, 1.0, 1.0))
    whole, merged, _, missing = on_one_grid([COARSE, inner], [np.zeros(COARSE.shape), np.ones(inner.shape)])
    assert missing == 0
    assert (merged == 1).sum() == 125
    assert (merged[2:7, 2:7, 2:7] == 1).all()
    assert whole.shape == (9, 9, 9)


def test_what_no_block_covers_is_a_hole() -> None:
    apart = BlockExtent((5, 5, 5), (1.0, 1.0, 1.0), (6.0, 0.0, 0.0))
    _, _, holes, missing = on_one_grid([COARSE, apart], [linear(COARSE), linear(apart)])
    assert missing == holes.sum() == 25
    assert holes[:, :, 5].all()


def test_holes_stay_holes() -> None:
    values = linear(COARSE)
    values[2, 2, 2] = np.nan
    held = BlockSamples(np.nan_to_num(values), np.isnan(values))
    laid = even_layout(common_lattice([COARSE]), 1)
    ((samples, missing),) = on_ranks(1, lambda ranks: resampled(held, (COARSE, COARSE), laid, ranks))
    assert missing == 1
    assert samples.holes[2, 2, 2]


def test_ghost_layers_close_gaps_but_never_hide_what_is_owned() -> None:
    held = [
        BlockExtent((3, 3, 6), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)),
        BlockExtent((3, 3, 6), (1.0, 1.0, 1.0), (3.5, 0.0, 0.0)),
    ]
    own = [
        BlockExtent((3, 3, 4), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)),
        BlockExtent((3, 3, 5), (1.0, 1.0, 1.0), (4.5, 0.0, 0.0)),
    ]
    laid = even_layout(Lattice((3, 3, 9), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)), 2)

    def work(ranks):
        values = np.full(held[ranks.number].shape, float(ranks.number))
        return resampled(BlockSamples(values), (held[ranks.number], own[ranks.number]), laid, ranks)

    parts = on_ranks(2, work)
    assert sum(missing for _, missing in parts) == 0
    row = np.concatenate([samples.values[0, 0] for samples, _ in parts])
    assert row[:4].tolist() == [0.0] * 4
    assert row[5:].tolist() == [1.0] * 4


@pytest.mark.parametrize("count", range(1, 14))
def test_even_boxes_fill_the_lattice(count) -> None:
    whole = Lattice((3, 2, 2), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    counts = np.zeros(whole.shape, dtype=int)
    for piece in even_layout(whole, count).boxes:
        counts[tuple(map(slice, piece.start, piece.stop))] += 1
    assert (counts == 1).all()


def test_a_value_at_a_sample_is_the_samples_even_next_to_a_hole() -> None:
    values = np.arange(27.0).reshape(3, 3, 3)
    values[0, 0, 1] = np.nan
    found = interpolated(values, [np.array([0.0]), np.array([0.0]), np.array([0.0, 0.5, 1.5, 2.0])])
    np.testing.assert_array_equal(np.isnan(found[0, 0]), [False, True, True, False])
