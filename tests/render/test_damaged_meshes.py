"""Meshes whose numbers lead out of their arrays are one error: VTK would read, or write, what is not theirs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import pyvista
import vtk
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from render.datasets import to_grid


def mesh() -> pyvista.UnstructuredGrid:
    found = pyvista.ImageData(dimensions=(4, 4, 4)).cast_to_structured_grid().cast_to_unstructured_grid()
    found.points[:] += 0.1 * np.sin(found.points[:, ::-1])
    found.point_data["f"] = np.arange(64.0)
    return found


def point(number: int) -> Callable[[Any], None]:
    def harm(found: Any) -> None:
        vtk_to_numpy(found.GetCells().GetConnectivityArray())[13] = number

    return harm


def offset(place: int, number: int) -> Callable[[Any], None]:
    def harm(found: Any) -> None:
        vtk_to_numpy(found.GetCells().GetOffsetsArray())[place] = number

    return harm


def another_type(found: Any) -> None:
    cells = vtk.vtkCellArray()
    cells.DeepCopy(found.GetCells())
    found.SetCells(numpy_to_vtk(np.full(27, 13, np.uint8), deep=True), cells)


def few_values(found: Any) -> None:
    array = numpy_to_vtk(np.arange(10.0), deep=True)
    array.SetName("f")
    found.GetPointData().AddArray(array)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (point(64), "cells have point 64, of 64 points: the mesh is damaged"),
        (point(10**9), "cells have point 1000000000, of 64 points"),
        (point(-3), "cells have point -3, of 64 points"),
        (offset(3, 10**6), "offsets do not follow"),
        (offset(27, 10**6), "offsets do not follow"),
        (offset(0, 4), "offsets do not follow"),
        (offset(3, 25), "cells of type 12 must have 8 points"),
        (another_type, "cells of type 13 must have 6 points"),
        (few_values, "array 'f' has 10 values for 64 points"),
    ],
)
def test_damaged_meshes_are_refused(harm: Callable[[Any], None], message: str) -> None:
    found = mesh()
    harm(found)
    with pytest.raises(ValueError, match=message):
        to_grid(found, array="f", warn=False)


def test_an_image_with_too_few_values_is_refused() -> None:
    image = vtk.vtkImageData()
    image.SetDimensions(4, 4, 4)
    few_values(image)
    with pytest.raises(ValueError, match="array 'f' has 10 values for 64 points"):
        to_grid(image)


@pytest.mark.parametrize("kind", [pyvista.UnstructuredGrid, pyvista.ExplicitStructuredGrid])
@pytest.mark.parametrize("number", [64, 10**6, -1])
@pytest.mark.parametrize("in_blocks", [False, True])
def test_points_are_checked_before_anything_is_asked_of_the_cells(
    kind: type[Any], number: int, in_blocks: bool
) -> None:
    found = pyvista.ImageData(dimensions=(4, 4, 4)).cast_to_unstructured_grid()  # of voxels
    if kind is pyvista.ExplicitStructuredGrid:
        found = pyvista.ImageData(dimensions=(4, 4, 4)).cast_to_structured_grid().cast_to_explicit_structured_grid()
    found.point_data["f"] = np.arange(64.0)
    point(number)(found)
    with pytest.raises(ValueError, match=f"cells have point {number}, of 64 points: the mesh is damaged"):
        to_grid(pyvista.MultiBlock([found]) if in_blocks else found, array="f", warn=False)


def test_an_explicit_grid_without_cells_is_refused() -> None:
    with pytest.raises(ValueError, match="is empty"):
        to_grid(vtk.vtkExplicitStructuredGrid())
    sized = vtk.vtkExplicitStructuredGrid()
    sized.SetDimensions(4, 4, 4)
    with pytest.raises(ValueError, match="is empty"):
        to_grid(sized)
