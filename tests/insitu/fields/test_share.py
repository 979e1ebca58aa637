"""One rank's block, cut from arrays with ghost layers, thin or empty."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface
from insitu.fields.field import Field
from insitu.fields.location import FieldLocation
from insitu.fields.share import ghost_layers, share_of
from insitu.mpi.layout import BlockExtent
from render.grids import Grid

SURFACE = (Isosurface("surface", 0.5),)
BOTH = (Isosurface("a", 0.5, field="q"), Isosurface("b", 0.5, field="speed"))
VALUES = np.arange(5 * 6 * 7, dtype=np.float64).reshape(5, 6, 7)


def share(data, appearances=SURFACE, nan="refuse", **place):
    found = share_of(data, appearances, FieldLocation(**{"spacing": (1.0, 2.0, 3.0), "nan": nan, **place}), appearances)
    assert found is not None
    return found


def test_a_rank_without_a_block_has_no_share() -> None:
    assert share_of(None, SURFACE, FieldLocation(), SURFACE) is None


@pytest.mark.parametrize(
    ("ghosts", "window", "origin"),
    [
        (0, np.s_[:, :, :], (0.0, 0.0, 0.0)),
        (1, np.s_[1:-1, 1:-1, 1:-1], (1.0, 2.0, 3.0)),
        ((2, 1, 0), np.s_[:, 1:-1, 2:-2], (2.0, 2.0, 0.0)),
        (((2, 1), 0, (0, 1)), np.s_[:-1, :, 2:-1], (2.0, 0.0, 0.0)),
    ],
)
def test_ghost_layers_are_no_part_of_the_block(ghosts, window, origin) -> None:
    found = share(VALUES, ghosts=ghosts, origin=(0.0, 0.0, 0.0))
    np.testing.assert_array_equal(found.owned("").values, VALUES[window])
    assert found.own == BlockExtent(VALUES[window].shape, (1.0, 2.0, 3.0), origin)
    assert found.extent == BlockExtent(VALUES.shape, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(found.fields[""].values, VALUES)


@pytest.mark.parametrize("ghosts", [-1, (1, 1), 1.5, "1", ((1, 2, 3), 0, 0), (1, 1, -2)])
def test_ghosts_that_are_none_are_refused(ghosts) -> None:
    with pytest.raises((ValueError, TypeError), match="ghosts must be a number of layers on every side"):
        ghost_layers(ghosts)


def test_a_block_of_ghosts_alone_is_refused() -> None:
    with pytest.raises(ValueError, match="the block has 7 x 6 x 5 samples, none but its ghost layers"):
        share(VALUES, ghosts=3)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("dims", [None, ("x", "y", "z")])
def test_a_single_layer_is_a_block(axis, dims) -> None:
    values = np.take(VALUES, [2], axis=axis)
    found = share(values, dims=dims)
    expected = values if dims is None else values.transpose(2, 1, 0)
    np.testing.assert_array_equal(found.owned("").values, expected)
    assert found.own.shape == expected.shape


def test_a_block_of_holes_alone_is_a_block() -> None:
    found = share(np.full((3, 4, 5), np.nan), nan="transparent")
    assert found.owned("").holes.all()
    with pytest.raises(ValueError, match="NaN or infinite"):
        share(np.full((3, 4, 5), np.nan))


def test_one_field_may_be_holes_alone_and_the_other_not() -> None:
    found = share({"q": np.full((3, 4, 5), np.inf), "speed": np.ones((3, 4, 5))}, BOTH, nan="transparent")
    assert found.fields["q"].holes.all()
    assert found.fields["speed"].holes is None


def test_nan_in_ghost_layers_is_nobodys_business() -> None:
    values = VALUES.copy()
    values[0], values[:, :, -1] = np.nan, np.inf
    assert share(values, ghosts=1).owned("").holes.sum() == 0
    values[2, 2, 2] = np.nan
    with pytest.raises(ValueError, match='1 of 60 values are NaN or infinite: pass nan="transparent"'):
        share(values, ghosts=1)
    assert share(values, ghosts=1, nan="transparent").owned("").holes.sum() == 1


def test_fields_that_know_their_place_and_name() -> None:
    field = Field(VALUES.astype(np.float32), (0.5, 0.5, 0.5), (1.0, 2.0, 3.0), name="speed", unit="m/s")
    found = share_of(field, SURFACE, FieldLocation(), SURFACE)
    assert found.own == BlockExtent(VALUES.shape, (0.5, 0.5, 0.5), (1.0, 2.0, 3.0))
    assert found.quantities[""].unit == "m/s"
    grid = Grid(VALUES, (1.0, 1.0, 1.0), (0.0, 0.0, 9.0))
    assert share_of(grid, SURFACE, FieldLocation(), SURFACE).own.origin == (0.0, 0.0, 9.0)


def test_data_that_would_be_resampled_are_refused() -> None:
    import pyvista

    grid = pyvista.RectilinearGrid([0.0, 1.0, 3.0], [0.0, 1.0], [0.0, 1.0])
    grid["q"] = np.arange(12.0)
    with pytest.raises(ValueError, match="a block must hold samples of a uniform grid"):
        share_of(grid, SURFACE, FieldLocation(), SURFACE)
