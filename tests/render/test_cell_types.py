"""Every cell type of VTK: a linear field on points or cells is right to rounding, or the data are refused in one sentence."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista
import vtk

from render.datasets import to_grid

SHEAR = np.array([[1.0, 0.2, 0.1], [0.1, 1.3, 0.2], [0.0, 0.3, 0.9]])
COUNT = 4  # boxes along each axis
TETRA, VOXEL, HEXAHEDRON, WEDGE, PYRAMID = 10, 11, 12, 13, 14
LINEAR = {
    **dict.fromkeys((TETRA, 24, 71, 78), TETRA),
    VOXEL: VOXEL,
    **dict.fromkeys((HEXAHEDRON, 25, 29, 33, 72, 79), HEXAHEDRON),
    **dict.fromkeys((WEDGE, 26, 31, 32, 73, 80), WEDGE),
    **dict.fromkeys((PYRAMID, 27, 37), PYRAMID),
}
POINTS = {71: 10, 72: 27, 73: 18, 78: 10, 79: 27, 80: 18}  # of Lagrange and Bezier cells of second order
PARTS = {  # of a hexahedron, by its corners; 8 is its middle
    TETRA: ((0, 1, 3, 4), (1, 2, 3, 6), (1, 3, 4, 6), (1, 4, 5, 6), (3, 4, 6, 7)),
    WEDGE: ((0, 1, 3, 4, 5, 7), (1, 2, 3, 5, 6, 7)),
    PYRAMID: ((0, 1, 2, 3, 8), (4, 7, 6, 5, 8), (0, 4, 5, 1, 8), (1, 5, 6, 2, 8), (2, 6, 7, 3, 8), (3, 7, 4, 0, 8)),
    HEXAHEDRON: (tuple(range(8)),),
}
FACES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
REFUSED = (37, 41)  # on cells; the first also on points
VOLUMES = [*LINEAR, 15, 16, 41, 42]
NAMES = {n: cell.GetClassName() for n in range(100) if (cell := vtk.vtkGenericCell.InstantiateCell(n)) is not None}


def linear(points: np.ndarray) -> np.ndarray:
    return 3.0 * points[..., 0] - 2.0 * points[..., 1] + 0.5 * points[..., 2] + 1.0


def boxes() -> np.ndarray:
    """The corners and the middles of boxes, in VTK's order [C, 9, 3]."""
    corners = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1], [0.5] * 3]
    )
    starts = np.stack(np.meshgrid(*[np.arange(COUNT)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return (starts + corners).astype(float)


def parametric(kind: int) -> np.ndarray:
    """The places of a cell's points within it [N, 3]."""
    cell = vtk.vtkGenericCell.InstantiateCell(kind)
    if kind in POINTS:
        cell.GetPointIds().SetNumberOfIds(POINTS[kind])
        cell.GetPoints().SetNumberOfPoints(POINTS[kind])
        getattr(cell, "SetUniformOrderFromNumPoints", lambda count: cell.Initialize())(POINTS[kind])
    return np.array(cell.GetParametricCoords()).reshape(-1, 3)[: POINTS.get(kind, cell.GetNumberOfPoints())]


def cells(kind: int) -> np.ndarray:
    """The points [C, N, 3] of cells that fill a sheared box; prisms and the last ones alone stand beside each other."""
    if kind in (15, 16):
        return parametric(kind) @ SHEAR.T + 1.05 * boxes()[:, :1]
    if kind in (41, 42):
        return boxes()[:, :8] @ SHEAR.T
    if kind == VOXEL:
        return boxes()[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    base = LINEAR[kind]
    corners = boxes()[:, np.array(PARTS[base])].reshape(-1, len(PARTS[base][0]), 3) @ SHEAR.T
    inner, weights = vtk.vtkGenericCell.InstantiateCell(base), []
    for place in parametric(kind):
        found = [0.0] * corners.shape[1]
        inner.InterpolateFunctions(list(place), found)
        weights.append(found)
    return np.array(weights) @ corners


def mesh(kind: int) -> pyvista.UnstructuredGrid:
    points = cells(kind)
    count, size = points.shape[:2]
    made = vtk.vtkUnstructuredGrid()
    made.SetPoints(vtk.vtkPoints())
    made.GetPoints().SetDataTypeToDouble()
    for point in points.reshape(-1, 3):
        made.GetPoints().InsertNextPoint(*point)
    for number in range(count):
        first = number * size
        if kind == 42:
            faces = vtk.vtkIdList()
            for value in (len(FACES), *(n for face in FACES for n in (4, *(first + corner for corner in face)))):
                faces.InsertNextId(value)
            made.InsertNextCell(kind, faces)
        else:
            made.InsertNextCell(kind, size, list(range(first, first + size)))
    return pyvista.wrap(made)


def check(made: pyvista.UnstructuredGrid, array: str) -> float:
    """The largest error of a sample, of those that lie in cells."""
    grid = to_grid(made, array=array, warn=False)
    k, j, i = np.indices(grid.shape)
    places = np.stack([i, j, k], axis=-1) * grid.spacing + grid.origin
    known = np.ones(grid.shape, bool) if grid.holes is None else ~grid.holes
    assert known.mean() > 0.01
    return float(np.abs(grid.values - linear(places))[known].max())


@pytest.mark.parametrize("kind", [kind for kind in VOLUMES if kind != 37], ids=lambda kind: NAMES[kind])
def test_a_linear_field_on_points_is_right_to_rounding(kind: int) -> None:
    made = mesh(kind)
    made.point_data["f"] = linear(np.asarray(made.points, float))
    assert check(made, "f") < 1e-12


@pytest.mark.parametrize(
    "kind", [kind for kind in VOLUMES if kind not in (15, 16, *REFUSED)], ids=lambda kind: NAMES[kind]
)
def test_a_linear_field_on_cells_is_right_to_rounding(kind: int) -> None:
    made = mesh(kind)
    corners = {VOXEL: 8, 42: 8}.get(kind) or len(PARTS[LINEAR[kind]][0])
    middles = cells(kind)[:, :corners].mean(axis=1)  # [C, 3]
    if kind == PYRAMID:  # VTK's parametric centre, which pyvista's cell_centers gives
        middles = np.asarray(made.cell_centers().points, float)
    elif LINEAR.get(kind) == PYRAMID:
        middles = 0.75 * cells(kind)[:, :4].mean(axis=1) + 0.25 * cells(kind)[:, 4]
    made.cell_data["f"] = linear(middles)
    # VTK's middle of a wedge, and of its triangles, is 0.333333
    assert check(made, "f") < (1e-5 if LINEAR.get(kind) == WEDGE else 1e-11)


@pytest.mark.parametrize(("kind", "on_points"), [(37, False), (37, True), (41, False)])
def test_cells_that_vtk_does_not_know_well_enough_are_refused(kind: int, on_points: bool) -> None:
    made = mesh(kind)
    (made.point_data if on_points else made.cell_data)["f"] = np.arange(
        float(made.n_points if on_points else made.n_cells)
    )
    with pytest.raises(ValueError, match="divide them into tetrahedra"):
        to_grid(made)


@pytest.mark.parametrize("kind", [n for n in NAMES if n not in VOLUMES], ids=lambda kind: NAMES[kind])
def test_faces_edges_and_vertices_are_refused(kind: int) -> None:
    points = vtk.vtkPoints()
    for number in range(10):
        points.InsertNextPoint(number, number**2, number**3)
    made = vtk.vtkUnstructuredGrid()
    made.SetPoints(points)
    size = (
        {0: 0, 1: 1, 3: 2, 5: 3, 8: 4, 9: 4}.get(kind)
        or vtk.vtkGenericCell.InstantiateCell(kind).GetNumberOfPoints()
        or 3
    )
    made.InsertNextCell(kind, size, list(range(size)))
    wrapped = pyvista.wrap(made)
    wrapped.point_data["f"] = np.arange(10.0)
    with pytest.raises(TypeError, match="has no volume cells"):
        to_grid(wrapped)


@pytest.mark.parametrize("on_cells", [False, True])
def test_types_may_be_mixed(on_cells: bool) -> None:
    parts = []
    for number, kind in enumerate((42, 12, 25, 10, 5)):
        part = mesh(kind) if kind != 5 else pyvista.Plane().triangulate().cast_to_unstructured_grid()
        part.points = np.asarray(part.points, float) + SHEAR @ [0.0, 0.0, COUNT * number]
        where = part.points if not on_cells else part.cell_centers().points
        (part.cell_data if on_cells else part.point_data)["f"] = linear(np.asarray(where, float))
        parts.append(part)
    append = vtk.vtkAppendFilter()
    append.SetOutputPointsPrecision(vtk.vtkAlgorithm.DOUBLE_PRECISION)
    for part in parts:
        append.AddInputData(part)
    append.Update()
    assert check(pyvista.wrap(append.GetOutput()), "f") < 1e-11


def test_the_table_holds_every_type() -> None:
    assert set(VOLUMES) <= set(NAMES)
    volumes = {kind for kind in NAMES if vtk.vtkGenericCell.InstantiateCell(kind).GetCellDimension() == 3}
    assert volumes == set(VOLUMES)


def test_a_polyhedrons_value_belongs_to_its_centroid() -> None:
    """Prisms of five sides, whose boxes have another middle: alone they are constant, around their value."""
    made = mesh(15)
    outline = cells(15)[:, :5]
    faces = [[0, 4, 3, 2, 1], [5, 6, 7, 8, 9], *([i, (i + 1) % 5, (i + 1) % 5 + 5, i + 5] for i in range(5))]
    parts = vtk.vtkUnstructuredGrid()
    parts.SetPoints(made.GetPoints())
    for number in range(made.n_cells):
        held = vtk.vtkIdList()
        for value in (7, *(n for face in faces for n in (len(face), *(10 * number + corner for corner in face)))):
            held.InsertNextId(value)
        parts.InsertNextCell(42, held)
    from render.cell_types import centers

    # the centroid of a polygon: its triangles' weighted by their areas
    fan = np.stack([np.broadcast_to(outline[:, :1], (len(outline), 3, 3)), outline[:, 1:4], outline[:, 2:5]], axis=2)
    areas = np.linalg.norm(np.cross(fan[:, :, 1] - fan[:, :, 0], fan[:, :, 2] - fan[:, :, 0]), axis=2)
    base = np.sum(fan.mean(axis=2) * areas[..., None], axis=1) / areas.sum(axis=1)[:, None]
    expected = base + (cells(15)[:, 5] - outline[:, 0]) / 2
    np.testing.assert_allclose(centers(parts), expected, atol=1e-12)
