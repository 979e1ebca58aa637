"""Samples of a VTK or pyvista data set on a regular grid.

Image data are taken as they are.  Anything else is resampled, with a `ResamplingWarning` that says at which
resolution and by which method, because resampling decides what can be seen.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.grids import Triple, warn_resampled

MOST_SAMPLES = 256  # per axis, when data are resampled
UNIFORM = 1e-5  # relative deviation below which rectilinear coordinates count as evenly spaced

Samples = tuple[NDArray[Any], Triple, Triple, NDArray[np.bool_] | None]


def samples_of(data: Any, array: str | None) -> Samples:
    """(values (nz, ny, nx), spacing, origin, outside) of a vtkDataSet.

    `outside` marks samples that lie outside the data set's cells (None where there are none).
    Raises TypeError for data sets without volume cells, ValueError for arrays that cannot be chosen or used.
    """
    if data.IsA("vtkCompositeDataSet"):
        raise TypeError(f"a {data.GetClassName()} has several blocks: combine them first (pyvista: `.combine()`)")
    if not data.IsA("vtkDataSet"):
        raise TypeError(f"a {data.GetClassName()} holds no field on cells or points")
    if data.GetNumberOfCells() == 0:
        raise ValueError(f"the {data.GetClassName()} is empty: it has {data.GetNumberOfPoints()} points and no cells")
    name, on_cells = choose_array(data, array)
    if data.IsA("vtkImageData") and _aligned(data):
        return _image_samples(data, name, on_cells)
    if data.IsA("vtkRectilinearGrid"):
        return _rectilinear_samples(data, name, on_cells)
    return _probed_samples(data, name, on_cells)


def choose_array(data: Any, array: str | None) -> tuple[str, bool]:
    """(name, is it cell data) of the array to render: the one asked for, or the only one there is."""
    on_points, on_cells = _scalar_names(data.GetPointData()), _scalar_names(data.GetCellData())
    if array is not None:
        if array in on_points and array in on_cells:
            raise ValueError(f"both points and cells have an array {array!r}: remove or rename one of them")
        if array not in on_points + on_cells:
            raise ValueError(f"no array {array!r} in the {data.GetClassName()}: it has {_listed(on_points, on_cells)}")
    elif len(on_points + on_cells) != 1:
        raise ValueError(f"name the array to render: the {data.GetClassName()} has {_listed(on_points, on_cells)}")
    else:
        array = (on_points + on_cells)[0]
    held = (data.GetPointData() if array in on_points else data.GetCellData()).GetArray(array)
    if held.GetNumberOfComponents() != 1:
        raise ValueError(
            f"array {array!r} has {held.GetNumberOfComponents()} components per sample: pass a scalar, "
            "such as the vector's magnitude"
        )
    return array, array in on_cells


def _image_samples(data: Any, name: str, on_cells: bool) -> Samples:
    points = np.array(data.GetDimensions())  # x, y, z
    spacing = np.array(data.GetSpacing())
    origin = np.array(data.GetOrigin()) + spacing * np.array(data.GetExtent())[::2]
    if on_cells:  # a cell's value belongs to its centre
        points, origin = points - 1, origin + spacing / 2
    values = _values(data, name, on_cells).reshape(points[::-1])
    return values, _triple(spacing), _triple(origin), None


def _rectilinear_samples(data: Any, name: str, on_cells: bool) -> Samples:
    from scipy.interpolate import RegularGridInterpolator
    from vtkmodules.util.numpy_support import vtk_to_numpy

    axes = [
        vtk_to_numpy(get()).astype(np.float64)
        for get in (data.GetXCoordinates, data.GetYCoordinates, data.GetZCoordinates)
    ]
    if on_cells:
        axes = [(axis[1:] + axis[:-1]) / 2 for axis in axes]
    values = _values(data, name, on_cells).reshape([len(axis) for axis in reversed(axes)])
    if min(values.shape) < 2:  # refused by the grid, which names the shape
        return values, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), None
    steps = [np.diff(axis) for axis in axes]
    for letter, step in zip("xyz", steps, strict=True):
        if not (step > 0).all():
            raise ValueError(f"the rectilinear grid's {letter} coordinates must increase strictly")
    origin = [axis[0] for axis in axes]
    if all(np.ptp(step) <= UNIFORM * step.mean() for step in steps):
        return values, _triple([step.mean() for step in steps]), _triple(origin), None
    counts = [_samples_along(axis[-1] - axis[0], float(step.min())) for axis, step in zip(axes, steps, strict=True)]
    fine = [np.linspace(axis[0], axis[-1], count) for axis, count in zip(axes, counts, strict=True)]
    interpolate = RegularGridInterpolator(axes[::-1], values.astype(np.float64))
    resampled = np.stack(
        [interpolate(np.stack(np.meshgrid([z], fine[1], fine[0], indexing="ij"), axis=-1))[0] for z in fine[2]]
    )  # [nz, ny, nx]
    nx, ny, nz = counts
    warn_resampled(
        f"the rectilinear grid is unevenly spaced: array {name!r} was resampled from "
        f"{' x '.join(str(len(axis)) for axis in axes)} to {nx} x {ny} x {nz} samples (trilinear)"
        + _coarser([float(step.min()) for step in steps], [f[1] - f[0] for f in fine])
    )
    return resampled, _triple([f[1] - f[0] for f in fine]), _triple(origin), None


def _probed_samples(data: Any, name: str, on_cells: bool) -> Samples:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkResampleToImage

    if data.GetMaxSpatialDimension() < 3:
        raise TypeError(f"the {data.GetClassName()} has no volume cells, only surfaces, lines or points")
    bounds = np.array(data.GetBounds()).reshape(3, 2)  # [3, 2]
    extent = bounds[:, 1] - bounds[:, 0]  # [3]
    typical = float((extent.prod() / data.GetNumberOfCells()) ** (1 / 3))  # edge of a cell of mean size
    counts = [_samples_along(length, typical) for length in extent]
    resample = vtkResampleToImage()
    resample.SetInputDataObject(data)
    resample.SetUseInputBounds(True)
    resample.SetSamplingDimensions(*counts)
    resample.Update()
    image = resample.GetOutput()
    values = vtk_to_numpy(image.GetPointData().GetArray(name)).reshape(counts[::-1])
    outside = vtk_to_numpy(image.GetPointData().GetArray("vtkValidPointMask")).reshape(counts[::-1]) == 0
    method = "piecewise constant in each cell" if on_cells else "interpolated linearly in each cell"
    nx, ny, nz = counts
    warn_resampled(
        f"the {data.GetClassName()} of {data.GetNumberOfCells()} cells is no regular grid: array {name!r} was "
        f"resampled to {nx} x {ny} x {nz} samples ({method}); {outside.mean():.1%} of them lie outside its cells "
        "and are transparent" + _coarser([typical] * 3, list(np.array(image.GetSpacing())))
    )
    return values, _triple(image.GetSpacing()), _triple(image.GetOrigin()), outside


def _values(data: Any, name: str, on_cells: bool) -> NDArray[Any]:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy((data.GetCellData() if on_cells else data.GetPointData()).GetArray(name))


def _scalar_names(attributes: Any) -> list[str]:
    """Names of the numeric arrays, without VTK's own bookkeeping (ghost flags, ids)."""
    arrays = [attributes.GetArray(i) for i in range(attributes.GetNumberOfArrays())]
    names = [held.GetName() for held in arrays if held is not None and held.GetName()]
    return [name for name in names if not name.startswith("vtk")]


def _listed(on_points: list[str], on_cells: list[str]) -> str:
    if not on_points + on_cells:
        return "no named numeric array"
    return f"point arrays {on_points} and cell arrays {on_cells}"


def _aligned(data: Any) -> bool:
    matrix = data.GetDirectionMatrix()
    return all(matrix.GetElement(i, j) == float(i == j) for i in range(3) for j in range(3))


def _samples_along(length: float, spacing: float) -> int:
    return int(np.clip(np.round(length / spacing) + 1, 2, MOST_SAMPLES))


def _coarser(wanted: list[float], got: list[float]) -> str:
    worst = max(g / w for g, w in zip(got, wanted, strict=True))
    return f"; that is {worst:.1f} times coarser than the finest cells" if worst > 1.5 else ""


def _triple(values: Any) -> Triple:
    x, y, z = map(float, values)
    return x, y, z
