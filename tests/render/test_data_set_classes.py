"""Every class of VTK's data: a linear field is right, without what is hidden, or the data are refused in one sentence."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest
import pyvista
import vtk

from render.datasets import to_grid
from tests.support.vtk_data import COMPOSITES, GARBAGE, GRIDS, add, centers, check, image, linear, tree


@pytest.mark.parametrize("on_cells", [False, True])
@pytest.mark.parametrize("name", GRIDS)
def test_a_linear_field_on_a_grid(name: str, on_cells: bool) -> None:
    data = GRIDS[name]()
    if on_cells:
        add(data.GetCellData(), "f", linear(centers(data)))
    else:
        points = np.array([data.GetPoint(i) for i in range(data.GetNumberOfPoints())])
        add(data.GetPointData(), "f", linear(points))
    check(to_grid(data, warn=False))


@pytest.mark.parametrize("hide", ["cells", "points"])
@pytest.mark.parametrize("on_cells", [False, True])
@pytest.mark.parametrize("name", GRIDS)
def test_hidden_cells_and_those_at_hidden_points_have_no_value(name: str, on_cells: bool, hide: str) -> None:
    data = GRIDS[name]()
    middles, points = centers(data), np.array([data.GetPoint(i) for i in range(data.GetNumberOfPoints())])
    limit = float(np.quantile(middles[:, 2], 0.7))  # the uppermost cells
    at, flag, part = (middles, 32, data.GetCellData()) if hide == "cells" else (points, 2, data.GetPointData())
    hidden = at[:, 2] > limit
    where, held = (middles, data.GetCellData()) if on_cells else (points, data.GetPointData())
    values = linear(where)
    if on_cells == (hide == "cells"):
        values = np.where(hidden, GARBAGE, values)
    add(held, "f", values)
    add(part, "vtkGhostType", (flag * hidden).astype(np.uint8))
    seen = check(to_grid(data, array="f", warn=False), 0.1)
    assert seen[:, 2].max() < points[:, 2].max() - 0.1


@pytest.mark.parametrize("name", COMPOSITES)
def test_a_linear_field_in_parts(name: str) -> None:
    check(to_grid(COMPOSITES[name](), array="f", warn=False))


def test_masked_cells_of_a_tree_have_no_value() -> None:
    whole, grid = to_grid(tree(), array="f", warn=False), to_grid(tree(masked=True), array="f", warn=False)
    assert whole.holes is None
    assert grid.holes is not None
    assert 0.2 < grid.holes.mean() < 0.9
    assert whole.range[0] - 1 <= grid.range[0] < grid.range[1] <= whole.range[1] + 1


KNOWN = {name.partition(",")[0] for name in (*GRIDS, *COMPOSITES)}
CLASSES = [
    kind
    for name in sorted(dir(vtk))
    if inspect.isclass(kind := getattr(vtk, name)) and issubclass(kind, vtk.vtkDataObject) and name not in KNOWN
]


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_other_classes_are_refused(kind: type[Any]) -> None:
    try:
        made = kind()
    except TypeError:
        return  # an abstract class
    with pytest.raises((TypeError, ValueError)) as caught:
        to_grid(made, array="f")
    assert kind.__name__ in str(caught.value)
    assert len(str(caught.value)) < 200


def volume_and_walls(value: float, on_cells: bool, apart: bool) -> Any:
    """Boxes beside the faces around them, an edge far outside and a vertex, with `value` on all but the boxes."""
    volume = image().cast_to_unstructured_grid()
    others = [
        volume.extract_surface(algorithm="dataset_surface").cast_to_unstructured_grid(),
        pyvista.Line((0.0, 0.0, 0.0), (11.0, 22.0, 31.0)).cast_to_unstructured_grid(),
        pyvista.PointSet([[99.0, 0.0, 0.0]]).cast_to_unstructured_grid(),
    ]
    for part in (volume, *others):
        part.clear_data()
        where = part.cell_centers().points if on_cells else part.points
        values = linear(np.asarray(where, float)) if part is volume else np.full(len(where), value)
        (part.cell_data if on_cells else part.point_data)["f"] = values
    return pyvista.MultiBlock([*others, volume]) if apart else pyvista.merge([*others, volume], merge_points=False)


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("on_cells", [False, True])
@pytest.mark.parametrize("value", [0.0, np.nan])
def test_only_volume_cells_count(value: float, on_cells: bool, apart: bool) -> None:
    alone = image()
    add(alone.GetCellData() if on_cells else alone.GetPointData(), "f", np.zeros(120 if on_cells else 210))
    expected = to_grid(alone)
    grid = to_grid(volume_and_walls(value, on_cells, apart), warn=False)
    check(grid, 0.99)
    np.testing.assert_allclose(np.stack(grid.bounds), np.stack(expected.bounds), atol=1e-5)
