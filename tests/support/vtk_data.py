"""Data sets of every class of VTK, with a field that is linear in space."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pyvista
import vtk
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

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
