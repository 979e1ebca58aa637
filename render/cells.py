"""Cells of VTK data sets: blocks joined, ghosts left out, and values of cells as a field.

A cell's value belongs to its centre.  Cells that fill a box in rows are samples there (`lattice`).  Others get the second-order
reconstruction of finite volumes (`reconstructed`): a linear function in each cell, through its value at its centre.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.cell_types import cell_types, centers, check_blocks, check_cells, extracted, straight

NO_CELLS = (
    1 | 8 | 16 | 32
)  # vtkDataSetAttributes: duplicate (another block's), refined (finer cells lie there), exterior, hidden
HIDDEN_CELLS = 8 | 32  # the same for grids, whose duplicates are the only ones there
HIDDEN_POINTS = 2
BOXES = (11, 12)  # VTK_VOXEL, VTK_HEXAHEDRON
ON_LATTICE = 1e-5  # of a cell's edge: how far a corner may lie from where it belongs
SOME = 1000  # cells that are looked at first, because one suffices to say no
COINCIDENT = 1e-7  # of the data set's diagonal: points that close are one
FLAT = 1e-9  # of the largest: a smaller squared extent of a cell's neighbourhood says nothing of the slope


def blocks(data: Any) -> Iterator[Any]:
    """The data sets with cells that a vtkCompositeDataSet holds, at any depth; of volumes and surfaces only the volumes."""
    if data.IsA("vtkOverlappingAMR"):
        data = _refined(data)
    leaves = [leaf for block in _leaves(data) if (leaf := plain(block)) is not None and leaf.GetNumberOfCells()]
    yield from [block for block in leaves if block.GetMaxSpatialDimension() == 3] or leaves


def _leaves(data: Any) -> Iterator[Any]:
    iterator = data.NewIterator()
    iterator.InitTraversal()
    while not iterator.IsDoneWithTraversal():
        yield iterator.GetCurrentDataObject()
        iterator.GoToNextItem()


def _refined(data: Any) -> Any:
    """A vtkOverlappingAMR whose coarse cells are marked where finer ones cover them."""
    from vtkmodules.vtkCommonDataModel import vtkAMRUtilities

    marked = data.NewInstance()
    marked.ShallowCopy(data)
    vtkAMRUtilities.BlankCells(marked)
    return marked


def plain(data: Any) -> Any:
    """Data as a vtkDataSet whose cells VTK's filters handle; None where they are of no such kind.

    Filters for unstructured grids write beyond their memory where an explicit structured grid has hidden cells.  Raises ValueError
    where the data set is damaged so that VTK would read memory of others.
    """
    if data.IsA("vtkHyperTreeGrid"):
        from vtkmodules.vtkFiltersHyperTree import vtkHyperTreeGridToUnstructuredGrid

        return _converted(vtkHyperTreeGridToUnstructuredGrid(), data)
    if data.IsA("vtkExplicitStructuredGrid"):
        check_blocks(data)
        from vtkmodules.vtkFiltersCore import vtkExplicitStructuredGridToUnstructuredGrid

        return _converted(vtkExplicitStructuredGridToUnstructuredGrid(), data)
    if data.IsA("vtkUnstructuredGrid"):
        check_cells(data)
    return data if data.IsA("vtkDataSet") else None


def _converted(filter_: Any, data: Any) -> Any:
    """The output of a filter, with the cell arrays of its input alone."""
    filter_.SetInputData(data)
    filter_.Update()
    dataset = filter_.GetOutput()
    attributes = dataset.GetCellData()
    for name in [attributes.GetArrayName(i) for i in range(attributes.GetNumberOfArrays())]:
        if not data.GetCellData().HasArray(name):
            attributes.RemoveArray(name)
    return dataset


def ghosts(attributes: Any, flags: int) -> NDArray[np.bool_] | None:
    """Which points or cells carry any of the flags; None where none does."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    array = attributes.GetArray("vtkGhostType")
    flags_set = None if array is None else (vtk_to_numpy(array) & flags) != 0
    return flags_set if flags_set is not None and flags_set.any() else None


def absent_cells(data: Any, flags: int) -> NDArray[np.bool_] | None:
    """Which cells of a vtkDataSet carry any of the flags, or have a hidden corner; None where none does."""
    absent, points = ghosts(data.GetCellData(), flags), ghosts(data.GetPointData(), HIDDEN_POINTS)
    if points is None:
        return absent
    corners, offsets = _connectivity(_appended([data]))
    lengths = np.diff(offsets)  # [C], 0 where VTK hides the cell itself
    owners = np.repeat(np.arange(len(lengths)), lengths)
    hidden: NDArray[np.bool_] = (lengths == 0) | (np.bincount(owners[points[corners]], minlength=len(lengths)) > 0)
    return hidden if absent is None else hidden | absent


def joined(data: list[Any]) -> Any:
    """One vtkUnstructuredGrid of the volume cells of all data sets without ghosts, points of several blocks not merged."""
    return _appended([_present(block) for block in data])


def _appended(data: list[Any]) -> Any:
    """One vtkUnstructuredGrid of all cells, in their order."""
    from vtkmodules.vtkFiltersCore import vtkAppendFilter

    append = vtkAppendFilter()
    for block in data:
        append.AddInputDataObject(_on_points(block))
    append.Update()
    return append.GetOutput()


def _present(data: Any) -> Any:
    """The volume cells of a data set but ghosts and hidden ones; the data set itself where it has no others."""
    absent = absent_cells(data, NO_CELLS)
    if data.IsA("vtkUnstructuredGrid"):
        flat = _flat(data)
        absent = flat if absent is None else flat | absent
    return data if absent is None or not absent.any() else extracted(_appended([data]), ~absent)


def _flat(mesh: Any) -> NDArray[np.bool_]:
    """Which cells [C] of a vtkUnstructuredGrid are faces, edges or vertices."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    cell, flat = vtkGenericCell(), []
    for kind in vtk_to_numpy(mesh.GetDistinctCellTypesArray()):
        cell.SetCellType(int(kind))
        if cell.GetCellDimension() < 3:
            flat.append(kind)
    return np.isin(cell_types(mesh), flat) if flat else np.zeros(mesh.GetNumberOfCells(), dtype=bool)


def _on_points(data: Any) -> Any:
    """Image data and rectilinear grids as a vtkStructuredGrid: appending would forget how they are turned, and round points."""
    from vtkmodules.vtkFiltersGeneral import vtkImageDataToPointSet, vtkRectilinearGridToPointSet

    if not data.IsA("vtkImageData") and not data.IsA("vtkRectilinearGrid"):
        return data
    converted = vtkImageDataToPointSet() if data.IsA("vtkImageData") else vtkRectilinearGridToPointSet()
    converted.SetInputData(data)
    converted.Update()
    return converted.GetOutput()


def edges_along_axes(mesh: Any, share: float) -> NDArray[np.float64]:
    """The extent [3] along x, y and z of the thinnest cells of a vtkUnstructuredGrid but a `share`, means over a point's cells.

    Means, because unstructured meshes have single slivers, which say nothing of the field.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy

    corners, offsets = _connectivity(mesh)  # [K], [C + 1]
    lengths = np.diff(offsets)
    points = vtk_to_numpy(mesh.GetPoints().GetData())  # [P, 3]
    count = np.bincount(corners, minlength=len(points))  # cells at each point
    edges = np.empty(3)
    for axis in range(3):
        at = points[corners, axis].astype(np.float64)
        extents = np.maximum.reduceat(at, offsets[:-1]) - np.minimum.reduceat(at, offsets[:-1])  # [C]
        around = np.bincount(corners, np.repeat(extents, lengths), len(points))[count > 0] / count[count > 0]
        around = around[around > 0]
        edges[axis] = (
            np.partition(around, int(share * len(around)))[int(share * len(around))] if len(around) else np.inf
        )
    return edges


def lattice(mesh: Any, values: NDArray[Any], on_cells: bool) -> tuple[NDArray[Any], list[NDArray[np.float64]]] | None:
    """(values [nz, ny, nx], their coordinates along x, y and z) of a vtkUnstructuredGrid's cells [C], at centres, or points [P].

    None unless the cells are boxes that fill a rectilinear grid; where two coincide the later one counts.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if not np.isin(vtk_to_numpy(mesh.GetDistinctCellTypesArray()), BOXES).all():
        return None
    points = vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64)  # [P, 3]
    rounding = 4 * np.finfo(np.float32).eps * np.abs(points).max(axis=0)  # [3]
    numbers = _connectivity(mesh)[0].reshape(-1, 8)  # [C, 8]
    if _boxes(points[numbers[:SOME].T], rounding) is None:
        return None
    corners = points[numbers.T]  # [8, C, 3]
    if (boxes := _boxes(corners, rounding)) is None:
        return None
    low, high, slack = boxes  # [C, 3] each
    axes, places = [], []
    for axis in range(3):
        ends = np.sort(np.concatenate([low[:, axis], high[:, axis]]))
        planes = ends[np.append(True, np.diff(ends) > 2 * slack[:, axis].min())]  # [n + 1]
        first = np.searchsorted(planes, low[:, axis] + slack[:, axis], side="right") - 1  # [C]
        last = np.searchsorted(planes, high[:, axis] + slack[:, axis], side="right") - 1
        if (last != first + 1).any():
            return None
        places.append(first)
        axes.append(planes)
    counts = [len(planes) - 1 for planes in reversed(axes)]
    if math.prod(counts) > len(numbers):
        return None
    is_filled = np.zeros(counts, dtype=bool)
    is_filled[tuple(places[::-1])] = True
    if not is_filled.all():
        return None
    if on_cells:
        axes = [(planes[1:] + planes[:-1]) / 2 for planes in axes]
    else:
        is_high = corners > (low + high) / 2  # [8, C, 3]
        places = [(first + is_high[..., axis]).T for axis, first in enumerate(places)]  # [C, 8] each
        values = values[numbers]
    filled = np.empty([len(axis) for axis in reversed(axes)], dtype=values.dtype)
    filled[tuple(places[::-1])] = values
    return filled, axes


def _boxes(
    corners: NDArray[np.float64], rounding: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
    """The low and the high corner of boxes and their slack, [C, 3] each, from their corners [8, C, 3].

    None where a corner is farther than the slack from those of a box along the axes.
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    slack = ON_LATTICE * (high - low) + rounding
    return (low, high, slack) if (np.minimum(corners - low, high - corners) <= slack).all() else None


def reconstructed(
    mesh: Any, values: NDArray[np.float64], cells: NDArray[np.int64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The field [N] at `points` [N, 3], each in the cell of its index in `cells` [N], from values [C] of a vtkUnstructuredGrid.

    In each cell it is the plane through its value at its centre whose slope fits the cells around best (least squares).  It is cut
    off at the smallest and largest value around; at the mesh's boundary, with cells on one side only, as far above as below.
    Linear fields come out exactly.  Source: Barth & Jespersen 1989, "The design and application of upwind schemes on unstructured
    meshes".
    """
    middles = centers(mesh)  # [C, 3]
    slopes, low, high = _slopes(mesh, middles, values)
    estimates = np.sum((points - middles[cells]) * slopes[cells], axis=1) + values[cells]
    return np.clip(estimates, low[cells], high[cells])


def _slopes(
    mesh: Any, centers: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Each cell's slope [C, 3], and the smallest and largest value [C] that its field may reach."""
    merged = _merged(mesh)
    corners, offsets = _connectivity(merged)  # [K], [C + 1]
    owners = np.repeat(np.arange(len(values)), np.diff(offsets))  # [K]
    count = merged.GetNumberOfPoints()

    def around(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums [C] over all cells at a cell's corners, those at several corners counted several times."""
        return np.add.reduceat(np.bincount(corners, numbers[owners], count)[corners], offsets[:-1])

    size = float(np.ptp(centers, axis=0).max()) or 1.0
    x, f = (centers - centers.mean(axis=0)) / size, values - values.mean()  # [C, 3], [C]
    number, total = around(np.ones(len(f))), around(f)
    sums, products = (np.stack([around(w * x[:, i]) for i in range(3)], axis=1) for w in (np.ones(len(f)), f))
    squares = np.empty((len(f), 3, 3))
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        about = around(x[:, i] * x[:, j]) - sums[:, i] * x[:, j] - sums[:, j] * x[:, i] + number * x[:, i] * x[:, j]
        squares[:, i, j] = squares[:, j, i] = about
    right = products - sums * f[:, None] - x * (total - number * f)[:, None]  # [C, 3]
    extents, axes = np.linalg.eigh(squares)  # [C, 3], [C, 3, 3]
    is_solid = extents > FLAT * extents[:, 2:]
    along = np.einsum("cij,ci->cj", axes, right) * np.where(is_solid, 1.0 / np.where(is_solid, extents, 1.0), 0.0)
    low, high = (_extreme(reduce, start, corners, owners, offsets, values, count) for reduce, start in _EXTREMES)
    reach = np.maximum(values - low, high - values)  # [C]
    outermost = _outermost(merged)  # [C]
    low, high = (np.where(outermost, values + sign * reach, end) for sign, end in ((-1, low), (1, high)))
    return np.einsum("cij,cj->ci", axes, along) / size, low, high


_EXTREMES: tuple[tuple[np.ufunc, float], ...] = ((np.minimum, np.inf), (np.maximum, -np.inf))


def _extreme(
    reduce: np.ufunc,
    start: float,
    corners: NDArray[np.int64],
    owners: NDArray[np.int64],
    offsets: NDArray[np.int64],
    values: NDArray[np.float64],
    count: int,
) -> NDArray[np.float64]:
    """The smallest or largest value [C] of all cells that share a corner with a cell."""
    at_points = np.full(count, start)
    reduce.at(at_points, corners, values[owners])
    extremes: NDArray[np.float64] = reduce.reduceat(at_points[corners], offsets[:-1])
    return extremes


def _outermost(mesh: Any) -> NDArray[np.bool_]:
    """Which cells [C] have a face that no other cell shares."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    surface = vtkGeometryFilter()
    surface.SetInputData(straight(mesh))
    surface.PassThroughCellIdsOn()
    surface.Update()
    is_outermost = np.zeros(mesh.GetNumberOfCells(), dtype=bool)
    is_outermost[vtk_to_numpy(surface.GetOutput().GetCellData().GetArray("vtkOriginalCellIds"))] = True
    return is_outermost


def _merged(mesh: Any) -> Any:
    """The same cells on points of which no two coincide, so that neighbours in other blocks are found."""
    from vtkmodules.vtkFiltersCore import vtkStaticCleanUnstructuredGrid

    clean = vtkStaticCleanUnstructuredGrid()
    clean.SetInputData(mesh)
    clean.ToleranceIsAbsoluteOff()
    clean.SetTolerance(COINCIDENT)
    clean.Update()
    return clean.GetOutput()


def _connectivity(mesh: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(point of each corner [K], where each cell's corners begin and the last one's end [C + 1])."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    cells = mesh.GetCells()
    return vtk_to_numpy(cells.GetConnectivityArray()), vtk_to_numpy(cells.GetOffsetsArray())
