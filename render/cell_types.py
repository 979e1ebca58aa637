"""Cells that VTK's own filters sample wrongly, or not at all: curved ones, and those of many faces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

CONVEX_POINT_SET, POLYHEDRON, TRIQUADRATIC_PYRAMID = 41, 42, 37
# Cells that are sampled by tetrahedra: VTK aborts the process (convex point sets), takes a cell for its whole box (polyhedra), or
# finds no points or another cell's in them (prisms of five and six sides, curved pyramids and wedges).
DIVIDED = (15, 16, 27, 31, 32, CONVEX_POINT_SET, POLYHEDRON)
CURVED = {  # the linear type on the first points of each: quadratic, Lagrange and Bezier cells
    **dict.fromkeys((24, 71, 78), 10),
    **dict.fromkeys((25, 29, 33, 72, 79), 12),
    **dict.fromkeys((26, 31, 32, 73, 80), 13),
    **dict.fromkeys((27, 37), 14),
}
CORNERS = {10: 4, 12: 8, 13: 6, 14: 5}
FIXED = (*range(10, 17), *range(24, 28), 29, 31, 32, 33, 37)  # types whose number of points is known
INEXACT = (24, 25, 26)  # VTK finds the place within these to a thousandth only


def cell_types(mesh: Any) -> NDArray[np.uint8]:
    """The type [C] of each cell of a vtkUnstructuredGrid."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkIdTypeArray

    kinds = vtk_to_numpy(mesh.GetDistinctCellTypesArray())
    types = np.full(mesh.GetNumberOfCells(), kinds[0] if len(kinds) else 0, dtype=np.uint8)
    for kind in kinds[1:]:
        numbers = vtkIdTypeArray()  # VTK would add to one that is used again
        mesh.GetIdsOfCellsOfType(int(kind), numbers)
        types[vtk_to_numpy(numbers)] = kind
    return types


def check_types(mesh: Any, on_cells: bool) -> None:
    """Raise ValueError where a vtkUnstructuredGrid has cells in which VTK can't find points, or whose faces it can't tell."""
    types = cell_types(mesh)
    if (types == TRIQUADRATIC_PYRAMID).any():
        raise ValueError("VTK finds no points within triquadratic pyramids: divide them into tetrahedra")
    if on_cells and (types == CONVEX_POINT_SET).any():
        raise ValueError("VTK can't tell the faces of convex point sets: divide them into tetrahedra")


def check_cells(mesh: Any) -> None:
    """Raise ValueError where cells or arrays of a vtkUnstructuredGrid name or lack points: VTK would read memory of others."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    cells, count = mesh.GetCells(), mesh.GetNumberOfPoints()
    if not mesh.GetNumberOfCells():
        return
    corners, offsets = vtk_to_numpy(cells.GetConnectivityArray()), vtk_to_numpy(cells.GetOffsetsArray())
    lengths = np.diff(offsets)
    if offsets[0] != 0 or offsets[-1] != len(corners) or (lengths < 0).any():
        raise ValueError("the cells' offsets do not follow each other: the mesh is damaged")
    faces = mesh.GetPolyhedronFaces()
    for numbers in (corners, *([] if faces is None else [vtk_to_numpy(faces.GetConnectivityArray())])):
        _check_corners(numbers, count)
    cell, types = vtkGenericCell(), cell_types(mesh)
    for kind in np.unique(types):
        cell.SetCellType(int(kind))
        fixed = cell.GetNumberOfPoints()
        if kind in FIXED and (lengths[types == kind] != fixed).any():
            raise ValueError(f"cells of type {kind} must have {fixed} points: the mesh is damaged")


def check_blocks(data: Any) -> None:
    """The same of a vtkExplicitStructuredGrid, whose cells have eight points each."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    cells, points, count = data.GetCells(), data.GetNumberOfPoints(), data.GetNumberOfCells()
    if cells is None or not points or not count:
        raise ValueError(f"the {data.GetClassName()} is empty: it lacks points or cells")
    corners = vtk_to_numpy(cells.GetConnectivityArray())
    if len(corners) != 8 * count or cells.GetNumberOfCells() != count:
        raise ValueError(f"{count} cells must have eight points each, got {len(corners)}: the mesh is damaged")
    _check_corners(corners, points)


def _check_corners(corners: NDArray[Any], count: int) -> None:
    if len(corners) and not 0 <= corners.min() <= corners.max() < count:
        wrong = corners.max() if corners.max() >= count else corners.min()
        raise ValueError(f"cells have point {wrong}, of {count} points: the mesh is damaged")


def straight(mesh: Any) -> Any:
    """A vtkUnstructuredGrid of the same cells without their arrays, curved ones by their corners alone."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid

    linear_mesh = vtkUnstructuredGrid()
    types = cell_types(mesh)
    if not np.isin(types, list(CURVED)).any():
        linear_mesh.CopyStructure(mesh)
        return linear_mesh
    cells = mesh.GetCells()
    corners, offsets = vtk_to_numpy(cells.GetConnectivityArray()), vtk_to_numpy(cells.GetOffsetsArray())
    linear = np.array([CURVED.get(kind, kind) for kind in range(256)], dtype=np.uint8)[types]
    few = np.array([CORNERS.get(kind, 0) for kind in range(256)])[linear]
    lengths = np.where(linear != types, few, np.diff(offsets))
    within = np.arange(len(corners)) - np.repeat(offsets[:-1], np.diff(offsets))
    corners_of_linear = corners[within < np.repeat(lengths, np.diff(offsets))]
    polygons = vtkCellArray()
    polygons.SetData(
        numpy_to_vtkIdTypeArray(np.append(0, np.cumsum(lengths)).astype(np.int64), deep=True),
        numpy_to_vtkIdTypeArray(corners_of_linear.astype(np.int64), deep=True),
    )
    linear_mesh.SetPoints(mesh.GetPoints())
    if (types == POLYHEDRON).any():
        faces = mesh.GetPolyhedronFaceLocations(), mesh.GetPolyhedronFaces()
        linear_mesh.SetPolyhedralCells(numpy_to_vtk(linear, deep=True), polygons, *faces)
    else:
        linear_mesh.SetCells(numpy_to_vtk(linear, deep=True), polygons)
    return linear_mesh


def divided(mesh: Any) -> Any:
    """The cells of a vtkUnstructuredGrid, some types as tetrahedra, with the array "vtkCell" of their numbers before."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkFiltersCore import vtkAppendFilter
    from vtkmodules.vtkFiltersGeneral import vtkDataSetTriangleFilter

    numbers = numpy_to_vtk(np.arange(mesh.GetNumberOfCells(), dtype=np.int64), deep=True)
    numbers.SetName("vtkCell")
    mesh.GetCellData().AddArray(numbers)
    many = np.isin(cell_types(mesh), DIVIDED)
    if not many.any():
        return mesh
    tetrahedra = vtkDataSetTriangleFilter()
    tetrahedra.SetInputData(extracted(mesh, many))
    append = vtkAppendFilter()
    append.AddInputConnection(tetrahedra.GetOutputPort())
    if not many.all():
        append.AddInputData(extracted(mesh, ~many))
    append.Update()
    return append.GetOutput()


def extracted(mesh: Any, selection: NDArray[np.bool_]) -> Any:
    """Some cells of a vtkUnstructuredGrid, with the points that they have."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkDataObject
    from vtkmodules.vtkFiltersCore import vtkThreshold

    mesh.GetCellData().RemoveArray("vtkGhostType")  # filters would act on it
    flags = numpy_to_vtk(selection.astype(np.uint8), deep=True)
    flags.SetName("vtkKept")
    mesh.GetCellData().AddArray(flags)
    threshold = vtkThreshold()
    threshold.SetInputData(mesh)
    threshold.SetInputArrayToProcess(0, 0, 0, vtkDataObject.FIELD_ASSOCIATION_CELLS, "vtkKept")
    threshold.SetUpperThreshold(0.5)
    threshold.SetThresholdFunction(vtkThreshold.THRESHOLD_UPPER)
    threshold.Update()
    return threshold.GetOutput()


def centers(mesh: Any) -> NDArray[np.float64]:
    """The parametric centre of each cell [C, 3]; of those that are divided the centroid."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkCellCenters

    filter_ = vtkCellCenters()
    filter_.SetInputData(straight(mesh))
    filter_.CopyArraysOff()
    filter_.Update()
    middles = vtk_to_numpy(filter_.GetOutput().GetPoints().GetData()).astype(np.float64)
    many = np.isin(cell_types(mesh), DIVIDED)
    if many.any():
        parts = divided(mesh)
        owners = vtk_to_numpy(parts.GetCellData().GetArray("vtkCell"))
        inside = many[owners]
        cells = parts.GetCells()
        corners, offsets = vtk_to_numpy(cells.GetConnectivityArray()), vtk_to_numpy(cells.GetOffsetsArray())
        points = vtk_to_numpy(parts.GetPoints().GetData()).astype(np.float64)
        four = points[corners[offsets[:-1][inside, None] + np.arange(4)]]  # [T, 4, 3]
        volumes = np.abs(np.linalg.det(four[:, 1:] - four[:, :1]))  # [T]
        sums = [np.bincount(owners[inside], volumes * x, len(middles)) for x in four.mean(axis=1).T]
        whole = np.bincount(owners[inside], volumes, len(middles))
        solid = many & (whole > 0)
        middles[solid] = np.stack(sums, axis=1)[solid] / whole[solid, None]
    return middles


def add_places(mesh: Any, name: str) -> bool:
    """Add the points' coordinates "vtkPlace" and the slopes "vtkSlope" of a point array; False where VTK needs no correction."""
    from vtkmodules.vtkCommonDataModel import vtkDataObject
    from vtkmodules.vtkFiltersGeneral import vtkGradientFilter

    if not np.isin(cell_types(mesh), INEXACT).any():
        return False
    gradient = vtkGradientFilter()
    gradient.SetInputData(mesh)
    gradient.SetInputScalars(vtkDataObject.FIELD_ASSOCIATION_POINTS, name)
    gradient.SetResultArrayName("vtkSlope")
    gradient.Update()
    mesh.GetPointData().AddArray(gradient.GetOutput().GetPointData().GetArray("vtkSlope"))
    place = mesh.GetPoints().GetData().NewInstance()
    place.DeepCopy(mesh.GetPoints().GetData())
    place.SetName("vtkPlace")
    mesh.GetPointData().AddArray(place)
    return True
