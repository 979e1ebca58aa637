"""One field on grids of several of VTK's classes, each with the writer of its XML files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pyvista
import vtk

COUNTS = (11, 8, 7)
VALUES = np.random.default_rng(0).random(COUNTS[::-1]).astype("f4") + 1  # [z, y, x]


def image() -> pyvista.ImageData:
    made = pyvista.ImageData(dimensions=COUNTS)
    made["t"] = VALUES.ravel()
    return made


GRIDS: dict[str, tuple[Callable[[], Any], type[Any]]] = {
    "i": (image, vtk.vtkXMLImageDataWriter),
    "r": (lambda: image().cast_to_rectilinear_grid(), vtk.vtkXMLRectilinearGridWriter),
    "s": (lambda: image().cast_to_structured_grid(), vtk.vtkXMLStructuredGridWriter),
    "u": (lambda: image().cast_to_unstructured_grid(), vtk.vtkXMLUnstructuredGridWriter),
}
