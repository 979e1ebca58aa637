"""Summaries of fields in blocks, against that of the whole."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from insitu.fields.summarize import FieldPart, summarize, summarize_part
from render.blocks import Lattice
from render.datasets import to_grid
from tests.support.decomposed import blocks_of, kd_boxes
from tests.support.mpi import on_ranks

RAMP = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0)), ((0.0, 0.0), (1.0, 1.0)), 1.0)
SHOWN = [VolumeRendering("dvr", RAMP), Isosurface("surface", 0.4)]


def field(holes: bool):
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in (21, 18, 24)), indexing="ij")
    values = np.clip(1 - np.sqrt(x**2 + 2 * y**2 + z**2), -0.2, None)
    if holes:
        values[(x > 0.2) & (y < 0.3) & (z > -0.5)] = np.nan
    return to_grid(values, spacing=(0.1, 0.2, 0.3), origin=(3.0, 2.0, 1.0), nan="transparent")


def of_blocks(grid, count, seed=0):
    boxes = kd_boxes(grid.shape, count, np.random.default_rng(seed))
    blocks = blocks_of(grid, boxes)
    whole = Lattice(grid.shape, grid.spacing, grid.origin)

    def work(ranks):
        part = FieldPart.of(blocks[ranks.number]) if ranks.number < count else FieldPart.none_of(whole)
        return summarize_part(part, SHOWN, (0.0, 1.0), ranks)

    return on_ranks(count + 1, work)


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("count", [1, 2, 6])
def test_blocks_have_the_histogram_and_the_even_points_of_the_whole(count, holes) -> None:
    grid = field(holes)
    whole = summarize(grid, SHOWN, (0.0, 1.0))
    for found in of_blocks(grid, count):
        assert (found.minimum, found.maximum) == (whole.minimum, whole.maximum)
        assert found.clipped_fraction == whole.clipped_fraction
        np.testing.assert_array_equal(found.histogram, whole.histogram)
        np.testing.assert_array_equal(found.even_points, whole.even_points)
        np.testing.assert_allclose(found.even_values, whole.even_values, atol=1e-6)


@pytest.mark.parametrize("holes", [False, True])
def test_points_lie_where_something_is_seen_with_the_fields_values(holes) -> None:
    grid = field(holes)
    summaries = of_blocks(grid, 5, seed=3)
    for other in summaries[1:]:
        for name, value in vars(other).items():
            np.testing.assert_array_equal(value, getattr(summaries[0], name))
    found = summaries[0]
    index = ((found.points - np.array(grid.origin)) / np.array(grid.spacing))[:, ::-1].T
    expected = map_coordinates(np.array(grid.values, dtype=np.float64), index, order=1, mode="nearest")
    np.testing.assert_allclose(found.point_values, expected, atol=1e-4)
    assert len(found.points) == 4000
    assert found.point_opacities.min() >= 0.0
    # as many in every eighth of the box as in the summary of the whole, but for chance
    whole = summarize(grid, SHOWN, (0.0, 1.0))
    middle = (np.array(grid.bounds[0]) + grid.bounds[1]) / 2
    counts = [np.bincount(((s.points > middle) @ [1, 2, 4]), minlength=8) for s in (found, whole)]
    assert np.abs(counts[0] - counts[1]).max() < 6 * np.sqrt(counts[1].max())


def test_a_field_that_shows_nothing_has_no_points() -> None:
    grid = to_grid(np.zeros((6, 6, 6)))
    blocks = blocks_of(grid, kd_boxes(grid.shape, 2, np.random.default_rng(0)))
    found, _ = on_ranks(2, lambda ranks: summarize_part(FieldPart.of(blocks[ranks.number]), SHOWN, (0.0, 1.0), ranks))
    assert len(found.points) == 0
    assert len(found.even_points) == 2000
