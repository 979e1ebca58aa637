"""Every class of VTK's data: a linear field is right, without what is hidden, or the data are refused in one sentence."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import pyvista
import vtk
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from render.datasets import to_grid
from render.grids import Grid

GARBAGE = 1e30
TURN = pyvista.Transform().rotate_z(20.0).matrix[:3, :3]


def linear(points: np.ndarray) -> np.ndarray:
    """At points (..., 3)."""
    return 3.0 * points[..., 0] - 2.0 * points[..., 1] + 0.5 * points[..., 2] + 1.0


def positions(grid: Grid) -> np.ndarray:
    k, j, i = np.indices(grid.shape)
    return np.stack([i, j, k], axis=-1) * grid.spacing + grid.origin  # [nz, ny, nx, 3]


def centers(data: Any) -> np.ndarray:
    filter_ = vtk.vtkCellCenters()
    filter_.SetInputData(data)
    filter_.Update()
    return vtk_to_numpy(filter_.GetOutput().GetPoints().GetData()).astype(float)


def add(part: Any, name: str, values: np.ndarray) -> None:
    array = numpy_to_vtk(values, deep=True)
    array.SetName(name)
    part.AddArray(array)


def image(**place: Any) -> pyvista.ImageData:
    return pyvista.ImageData(dimensions=(7, 6, 5), spacing=(0.5, 1.0, 0.7), origin=(10.0, 20.0, 30.0), **place)


def curved() -> pyvista.StructuredGrid:
    z, y, x = np.mgrid[0:1:5j, 0:1:6j, 0:1:7j]
    return pyvista.StructuredGrid(x**1.3 + 0.3 * y, y, z + 0.1 * x)


def uneven() -> pyvista.RectilinearGrid:
    return pyvista.RectilinearGrid(np.cumsum([0, 0.5, 1.0, 0.75, 0.2]), np.linspace(0, 3, 6), np.arange(5.0) ** 1.2)


def explicit() -> pyvista.ExplicitStructuredGrid:
    return pyvista.ExplicitStructuredGrid(curved())


def uniform() -> Any:
    found = vtk.vtkUniformGrid()
    found.DeepCopy(image())
    return found


def structured_points() -> Any:
    found = vtk.vtkStructuredPoints()
    found.DeepCopy(image())
    return found


GRIDS: dict[str, Callable[[], Any]] = {
    "vtkImageData": image,
    "vtkImageData, turned": lambda: image(direction_matrix=TURN),
    "vtkStructuredPoints": structured_points,
    "vtkUniformGrid": uniform,
    "vtkRectilinearGrid": uneven,
    "vtkStructuredGrid": curved,
    "vtkExplicitStructuredGrid": explicit,
    "vtkUnstructuredGrid": lambda: curved().cast_to_unstructured_grid(),
}


def tree(masked: bool = False) -> Any:
    """A vtkHyperTreeGrid of 3 x 3 x 3 trees, of which some are refined."""
    source = vtk.vtkRandomHyperTreeGridSource()
    source.SetDimensions(4, 4, 4)
    source.SetOutputBounds(0, 3, 0, 6, 0, 3)
    source.SetMaxDepth(2)
    source.SetMaskedFraction(0.3 if masked else 0.0)
    source.Update()
    found = source.GetOutput()
    centers_ = vtk.vtkHyperTreeGridCellCenters()
    centers_.SetInputData(found)
    centers_.Update()
    # cells are numbered tree by tree, coarse ones too, whose values nobody sees
    values = np.full(found.GetNumberOfCells(), GARBAGE)
    cursor, geometry = vtk.vtkHyperTreeGridNonOrientedGeometryCursor(), [0.0] * 3

    def visit() -> None:
        if cursor.IsMasked():
            return
        if cursor.IsLeaf():
            cursor.GetPoint(geometry)
            values[cursor.GetGlobalNodeIndex()] = linear(np.array(geometry))
            return
        for child in range(cursor.GetNumberOfChildren()):
            cursor.ToChild(child)
            visit()
            cursor.ToParent()

    for number in range(27):
        found.InitializeNonOrientedGeometryCursor(cursor, number)
        visit()
    add(found.GetCellData(), "f", values)
    return found


def refined() -> Any:
    """A vtkOverlappingAMR whose coarse cells hold garbage where finer ones cover them."""
    found = vtk.vtkOverlappingAMR()
    found.Initialize([1, 1])
    found.SetOrigin([0.0, 0.0, 0.0])
    found.SetGridDescription(vtk.vtkStructuredData.VTK_STRUCTURED_XYZ_GRID)
    for level, (origin, spacing) in enumerate(((0.0, 1.0), (1.0, 0.5))):
        block = vtk.vtkUniformGrid()
        block.SetDimensions(5, 5, 5)
        block.SetOrigin(origin, origin, origin)
        block.SetSpacing(spacing, spacing, spacing)
        middles = centers(block)
        covered = (level == 0) & ((middles > 1) & (middles < 3)).all(axis=1)
        add(block.GetCellData(), "f", np.where(covered, GARBAGE, linear(middles)))
        first = int(origin / spacing)
        found.SetSpacing(level, [spacing] * 3)
        found.SetRefinementRatio(level, 2)
        found.SetAMRBox(level, 0, vtk.vtkAMRBox(*[first] * 3, *[first + 3] * 3))
        found.SetDataSet(level, 0, block)
    return found


def halves(kind: type[Any]) -> Any:
    found = kind()
    for number, low in enumerate((10.0, 11.5)):
        half = pyvista.ImageData(dimensions=(4, 6, 5), spacing=(0.5, 1.0, 0.7), origin=(low, 20.0, 30.0))
        add(half.GetCellData(), "f", linear(centers(half)))
        if kind is vtk.vtkPartitionedDataSetCollection:
            found.SetPartition(number, 0, half)
        elif kind is vtk.vtkMultiPieceDataSet:
            found.SetPiece(number, half)
        elif kind is vtk.vtkPartitionedDataSet:
            found.SetPartition(number, half)
        else:
            found.SetBlock(number, half)
    return found


def levels() -> Any:
    found = vtk.vtkNonOverlappingAMR()
    found.Initialize([2])
    for number, low in enumerate((10.0, 11.5)):
        block = vtk.vtkUniformGrid()
        block.SetDimensions(4, 6, 5)
        block.SetSpacing(0.5, 1.0, 0.7)
        block.SetOrigin(low, 20.0, 30.0)
        add(block.GetCellData(), "f", linear(centers(block)))
        found.SetDataSet(0, number, block)
    return found


COMPOSITES: dict[str, Callable[[], Any]] = {
    "vtkMultiBlockDataSet": lambda: halves(vtk.vtkMultiBlockDataSet),
    "vtkMultiPieceDataSet": lambda: halves(vtk.vtkMultiPieceDataSet),
    "vtkPartitionedDataSet": lambda: halves(vtk.vtkPartitionedDataSet),
    "vtkPartitionedDataSetCollection": lambda: halves(vtk.vtkPartitionedDataSetCollection),
    "vtkNonOverlappingAMR": levels,
    "vtkOverlappingAMR": refined,
    "vtkHyperTreeGrid": tree,
}


def check(grid: Grid, share: float = 0.2) -> np.ndarray:
    """Compare all samples but holes with the function; return where these lie."""
    known = np.ones(grid.shape, dtype=bool) if grid.holes is None else ~grid.holes
    assert known.mean() > share
    where = positions(grid)[known]
    np.testing.assert_allclose(grid.values[known], linear(where), rtol=0, atol=1e-11)
    return where


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
