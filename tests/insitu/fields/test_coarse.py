"""Coarse fields are box averages of the trilinear field: compared with sums over many points, and block by block."""

from __future__ import annotations

from itertools import product
from math import prod

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.store.coarse import MOST_SAMPLES
from insitu.fields.coarse import Shape, axis_weights, coarse_shape, coarsened
from insitu.fields.summarize import FieldPart
from render.blocks import Lattice
from render.grids import Grid, checked_grid
from tests.support.decomposed import blocks_of, kd_boxes
from tests.support.mpi import ThreadRank, on_ranks

RNG = np.random.default_rng(11)
SPACING = (0.5, 1.0, 2.0)
SHAPES: dict[str, tuple[Shape, tuple[float, float, float], Shape]] = {  # z, y, x; spacing x, y, z; z, y, x
    "small": ((3, 4, 5), (1.0, 1.0, 1.0), (3, 4, 5)),
    "just small enough": ((64, 64, 64), (1.0, 1.0, 1.0), (64, 64, 64)),
    "flat, but small": ((2, 300, 400), (1.0, 1.0, 1.0), (2, 300, 400)),
    "one sample too many": ((65, 64, 64), (1.0, 1.0, 1.0), (64, 64, 64)),
    "a cube": ((512, 512, 512), (0.1, 0.1, 0.1), (64, 64, 64)),
    "a plate": ((16, 1000, 1000), (1.0, 1.0, 1.0), (16, 128, 128)),
    "a plate of tall cells": ((16, 1000, 1000), (1.0, 1.0, 60.0), (16, 128, 128)),
    "a channel": ((256, 256, 1024), (1.0, 1.0, 1.0), (40, 40, 160)),
    "a line": ((2, 2, 1_000_000), (1.0, 1.0, 1.0), (2, 2, 65536)),
    "samples far apart along x": ((66, 66, 66), (1e6, 1.0, 1.0), (63, 63, 66)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_lattices_are_fine_and_nearly_cubic(name: str) -> None:
    shape, spacing, expected = SHAPES[name]
    field = coarse_shape(shape, spacing)
    assert prod(field) <= MOST_SAMPLES
    assert all(2 <= m <= n for m, n in zip(field, shape, strict=True))
    assert np.allclose(field, expected, rtol=0.03)


@pytest.mark.parametrize(("samples", "coarse"), [(2, 2), (3, 2), (7, 2), (65, 64), (100, 64), (1000, 64), (64, 64)])
def test_weights_are_those_of_boxes_around_coarse_samples(samples: int, coarse: int) -> None:
    weights = axis_weights(samples, coarse).toarray()
    middles = np.linspace(0.0, samples - 1, coarse)
    assert np.allclose(weights.sum(axis=1), 1.0)
    assert (weights >= 0.0).all()
    assert np.allclose(weights @ np.arange(samples), middles)  # a linear function is exact, at the ends, too
    half = (samples - 1) / (coarse - 1) / 2.0 if coarse < samples else 0.0
    for middle, row in zip(middles, weights, strict=True):
        near = min(half, middle, samples - 1 - middle)
        at = middle + near * ((np.arange(20_000) + 0.5) / 10_000 - 1.0)  # evenly through the box
        below = np.minimum(at.astype(int), samples - 2)
        shares = np.bincount(below, 1.0 - (at - below), samples) + np.bincount(below + 1, at - below, samples)
        assert np.allclose(row, shares / len(at), atol=1e-6)


def slow(grid: Grid, shape: Shape) -> NDArray[np.float64]:
    """The coarse samples one by one, each a sum over all samples of the field."""
    finite = np.ones(grid.shape) if grid.holes is None else (~grid.holes).astype(np.float64)
    z, y, x = (axis_weights(n, m).toarray() for n, m in zip(grid.shape, shape, strict=True))
    field = np.empty(shape)
    for k, j, i in product(*map(range, shape)):
        weights = z[k][:, None, None] * y[j][:, None] * x[i]
        share = (weights * finite).sum()
        field[k, j, i] = (weights * finite * grid.values).sum() / share if share >= 0.5 else np.nan
    return field


def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse fields of at most 6³ samples."""
    monkeypatch.setattr("insitu.fields.coarse.MOST_SAMPLES", 216)
    monkeypatch.setattr("insitu.fields.coarse.AXIS", 6)


def test_averages_are_those_of_a_slow_sum(monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch)
    monkeypatch.setattr("insitu.fields.summarize.SLAB_VOXELS", 200)
    values = RNG.random((17, 9, 23))
    values[3:9, 2:7, 5:15] = np.nan
    grid = checked_grid(values, SPACING, (1.0, 2.0, 3.0), "transparent")
    field = coarsened(FieldPart.all_of(grid))
    assert field is not None
    assert not field.whole
    expected = slow(grid, field.values.shape)
    assert 0 < np.isnan(expected).sum() < expected.size
    np.testing.assert_allclose(field.values, expected, rtol=1e-12)
    last = np.array(field.origin) + np.array(field.spacing) * (np.array(field.values.shape[::-1]) - 1)
    np.testing.assert_allclose([field.origin, last], grid.bounds)


def test_linear_fields_stay_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch)
    z, y, x = np.meshgrid(*map(np.arange, (17, 9, 23)), indexing="ij")
    field = coarsened(FieldPart.all_of(Grid(2.0 * x - 3.0 * y + 0.5 * z)))
    assert field is not None
    z, y, x = np.meshgrid(
        *(np.linspace(0, n - 1, m) for n, m in zip((17, 9, 23), field.values.shape, strict=True)), indexing="ij"
    )
    np.testing.assert_allclose(field.values, 2.0 * x - 3.0 * y + 0.5 * z, atol=1e-12)


@pytest.mark.parametrize("dtype", ["float32", "float64", "int32", "int64"])
def test_small_fields_are_kept_as_they_are(dtype: str) -> None:
    values = (1000 * RNG.random((4, 5, 6))).astype(dtype)
    field = coarsened(FieldPart.all_of(Grid(values, SPACING, (1.0, 2.0, 3.0))))
    assert field is not None
    assert field.whole
    assert np.array_equal(field.values, values)
    assert (field.spacing, field.origin) == (SPACING, (1.0, 2.0, 3.0))


def test_holes_are_kept_where_the_field_is() -> None:
    values = np.where(RNG.random((4, 5, 6)) < 0.4, np.nan, 2.0)
    field = coarsened(FieldPart.all_of(checked_grid(values, 1.0, 0.0, "transparent")))
    assert field is not None
    assert np.array_equal(field.values, values, equal_nan=True)


def test_a_field_that_would_be_all_holes_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch)
    values = np.full((20, 20, 20), np.nan)
    values[10, 10, 10] = 1.0
    assert coarsened(FieldPart.all_of(checked_grid(values, 1.0, 0.0, "transparent"))) is None


def test_the_largest_numbers_stay_finite(monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch)
    field = coarsened(FieldPart.all_of(Grid(np.full((20, 20, 20), np.finfo(np.float64).max))))
    assert field is not None
    np.testing.assert_allclose(field.values / np.finfo(np.float64).max, 1.0)


@pytest.mark.parametrize("small", [False, True])
def test_blocks_make_the_same_as_one_process(monkeypatch: pytest.MonkeyPatch, small: bool) -> None:
    if not small:
        few(monkeypatch)
    values = RNG.random((17, 9, 23))
    values[3:9, 2:7, 5:15] = np.nan
    grid = checked_grid(values, SPACING, (1.0, 2.0, 3.0), "transparent")
    blocks = blocks_of(grid, kd_boxes(grid.shape, 5, np.random.default_rng(1)))
    whole = Lattice(grid.shape, grid.spacing, grid.origin)

    def work(ranks: ThreadRank) -> object:
        return coarsened(FieldPart.of(blocks[ranks.number]) if ranks.number < 5 else FieldPart.none_of(whole), ranks)

    one = coarsened(FieldPart.all_of(grid))
    first, *others = on_ranks(6, work)
    assert one is not None
    assert others == [None] * 5
    np.testing.assert_allclose(first.values, one.values, rtol=0.0 if small else 1e-13)
    assert (first.spacing, first.origin, first.whole) == (one.spacing, one.origin, one.whole)
