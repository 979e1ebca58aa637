"""Anything that holds a scalar field, an array or a VTK or pyvista data set, as a grid to render.

Arrays and image data are taken as they are.  Anything else is resampled, with a note that says at which
resolution and by which method, because resampling decides what can be seen.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.arrays import plain_array
from render.cell_types import add_places, check_types, divided
from render.cells import (
    HIDDEN_CELLS,
    HIDDEN_POINTS,
    absent_cells,
    blocks,
    edges_along_axes,
    ghosts,
    joined,
    lattice,
    plain,
    reconstructed,
)
from render.grids import Grid, checked_grid
from render.xarray_fields import axis_order, chosen, is_labelled, is_labelled_set, placed

MOST_SAMPLES = 256  # per axis, when data are resampled
THIN = 0.75  # of a cube of a cell's mean volume: cells that are thinner along an axis have samples of their own there
UNIFORM = 1e-5  # relative deviation below which rectilinear coordinates count as evenly spaced


class ResamplingWarning(UserWarning):
    """The data are not on a regular grid and were interpolated onto one."""


def to_grid(
    data: Any,
    *,
    spacing: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    array: str | None = None,
    dims: Sequence[str] | None = None,
    nan: str = "refuse",
    warn: bool = True,
) -> Grid:
    """A `Grid` of `data`.

    Parameters
    ----------
    data : a 3-D array indexed (z, y, x) of real numbers, any CPU array that speaks DLPack, or a VTK or pyvista data set.  An object
        with `values` (z, y, x), `spacing` and `origin` will do, such as `insitu.Field`; a `Grid` is returned as it is.  Masked
        values of a masked array count as NaN.  An xarray.DataArray, or one array of a Dataset, is taken by the names of its
        axes, at the place that its coordinates say; unevenly spaced ones are resampled.
    spacing, origin : distance between samples and place of the first, world units (x, y, z), of arrays (default: 1 and 0).  Data
        sets and coordinates have their own.
    array : name of the point or cell array of a data set; may be left out where there is only one.  Where points and cells have
        it, the cells' counts; "point:NAME" and "cell:NAME" choose.
    dims : what the axes of an array are, in its own order: ("x", "y", "z") for values [x, y, z].  By default as they are
        called, or (z, y, x).
    nan : "refuse" raises ValueError where a value is NaN or infinite; "transparent" makes every grid cell
        with such a corner transparent (see `Grid.holes`).
    warn : also give the `notes` of a resampled grid as warnings.

    Image data are taken sample by sample: points where they are, cell values at the cell centres.  The box is then half a cell
    smaller on each side, and no value is averaged with its neighbours.  Evenly spaced rectilinear grids are taken likewise, and so
    are cell values of any mesh of boxes that fill such a grid.  Other data are resampled; a `ResamplingWarning` says how.  The
    blocks of a composite data set are joined; ghost and hidden cells are left out.

    Raises ValueError naming what is wrong with shape, type, range, spacing or values, and TypeError for other data.

    Examples
    --------
    >>> from blobs import simulate
    >>> from render import to_grid
    >>> grid = to_grid(simulate(0.8, 0.3), spacing=(2 / 23,) * 3, origin=(-1, -1, -1))
    >>> grid.shape
    (24, 24, 24)
    """
    if isinstance(data, Grid):
        _check_own_place("Grid", spacing, origin, None)
        return data
    if hasattr(data, "IsA") and hasattr(data, "GetClassName"):
        _check_own_place(data.GetClassName(), spacing, origin, dims)
        return _with_warnings(_grid_of_data_set(data, array, nan), warn)
    if is_labelled_set(data):
        data, array = chosen(data, array), None
    if array is not None:
        raise ValueError(f"array={array!r} names an array of a VTK data set, but the data are {type(data).__name__}")
    if is_labelled(data):
        placement = placed(data, dims, spacing, origin)
        if placement.axes is not None:
            grid = _on_axes(placement.values, placement.axes, placement.name, "array", nan)
            return _with_warnings(replace(grid, notes=(*placement.notes, *grid.notes)), warn)
        data, dims = placement.values, None
    if all(hasattr(data, name) for name in ("values", "spacing", "origin")):
        spacing = data.spacing if spacing is None else spacing
        origin = data.origin if origin is None else origin
        data = data.values
    values = plain_array(data)
    if dims is not None and values.ndim == 3:
        order = axis_order("012", dims)
        values = values.transpose([int(order[letter]) for letter in "zyx"])
    return checked_grid(values, 1.0 if spacing is None else spacing, 0.0 if origin is None else origin, nan)


def _check_own_place(
    kind: str, spacing: ArrayLike | None, origin: ArrayLike | None, dims: Sequence[str] | None
) -> None:
    if spacing is not None or origin is not None:
        raise ValueError(f"a {kind} has its own spacing and origin: leave them out")
    if dims is not None:
        raise ValueError(f"a {kind} knows its own axes: leave dims out")


def _with_warnings(grid: Grid, warn: bool) -> Grid:
    """`grid`, its notes given as warnings at the line that called `to_grid`."""
    for note in grid.notes if warn else ():
        warnings.warn(note, ResamplingWarning, stacklevel=3)
    return grid


def _grid_of_data_set(data: Any, array: str | None, nan: str) -> Grid:
    """A grid of a vtkDataSet, or of the blocks of a vtkCompositeDataSet.

    Raises TypeError for data sets without volume cells, ValueError for arrays that cannot be chosen or used.
    """
    kind, leaves = data.GetClassName(), None
    if data.IsA("vtkCompositeDataSet"):
        leaves = list(blocks(data))
        if not leaves:
            raise ValueError(f"the {kind} is empty: none of its blocks has cells")
    elif (data := plain(data)) is None:
        raise TypeError(f"a {kind} holds no field on cells or points")
    elif data.GetNumberOfCells() == 0:
        raise ValueError(f"the {kind} is empty: it has {data.GetNumberOfPoints()} points and no cells")
    name, on_cells = chosen_array(
        leaves or [data], array, f"the blocks of the {kind} have" if leaves else f"the {kind} has"
    )
    if leaves is None:
        return _of_one(data, kind, name, on_cells, nan)
    chosen_blocks = [block for block in leaves if (name, on_cells) in _arrays(block)]
    if len(chosen_blocks) == 1:
        return _of_one(chosen_blocks[0], chosen_blocks[0].GetClassName(), name, on_cells, nan)
    return _of_mesh(chosen_blocks, f"{kind} of {len(chosen_blocks)} blocks", name, on_cells, nan)


def _of_one(data: Any, kind: str, name: str, on_cells: bool, nan: str) -> Grid:
    if data.IsA("vtkImageData") and _aligned(data):
        if on_cells or ghosts(data.GetCellData(), HIDDEN_CELLS) is None:
            return _from_image(data, name, on_cells, nan)
    elif data.IsA("vtkRectilinearGrid") and absent_cells(data, HIDDEN_CELLS) is None:
        return _from_rectilinear(data, name, on_cells, nan)
    return _of_mesh([data], kind, name, on_cells, nan)


def chosen_array(data: Sequence[Any], array: str | None, who: str) -> tuple[str, bool]:
    """(name, is it cell data) of the array to render in vtkDataSets: the one asked for, or the only one there is.

    Where points and cells have one of this name, that of the cells counts, which codes compute; "cell:NAME" and "point:NAME"
    choose.  Raises ValueError, its sentence going on from `who`, such as "the file has".
    """
    every = dict.fromkeys(names for one in data for names in _arrays(one))
    names = {name for name, _ in every if array in (None, name)}
    kind, _, name = (array or "").partition(":")
    if not names and kind in ("cell", "point") and (name, kind == "cell") in every:
        on_cells = kind == "cell"
    elif len(names) == 1:
        name = names.pop()
        on_cells = (name, True) in every
    else:
        listed = [sorted(name for name, on in every if on is which) for which in (False, True)]
        problem = "name the array to render" if array is None else f"no array {array!r}"
        raise ValueError(f"{problem}: {who} {_listed(*listed)}")
    for one in data:
        values = (one.GetCellData() if on_cells else one.GetPointData()).GetArray(name)
        if values is not None and values.GetNumberOfComponents() != 1:
            raise ValueError(
                f"array {name!r} has {values.GetNumberOfComponents()} components per sample: pass a scalar, such as the vector's "
                "magnitude"
            )
        count = one.GetNumberOfCells() if on_cells else one.GetNumberOfPoints()
        if values is not None and values.GetNumberOfTuples() != count:
            what = "cells" if on_cells else "points"
            raise ValueError(f"array {name!r} has {values.GetNumberOfTuples()} values for {count} {what}")
    return name, on_cells


def _arrays(data: Any) -> list[tuple[str, bool]]:
    """(name, is it cell data) of the numeric arrays."""
    on_points, on_cells = _scalar_names(data.GetPointData()), _scalar_names(data.GetCellData())
    return [*((name, False) for name in on_points), *((name, True) for name in on_cells)]


def _from_image(data: Any, name: str, on_cells: bool, nan: str) -> Grid:
    absent = absent_cells(data, HIDDEN_CELLS) if on_cells else ghosts(data.GetPointData(), HIDDEN_POINTS)
    points = np.array(data.GetDimensions())  # x, y, z
    spacing = np.array(data.GetSpacing())
    origin = np.array(data.GetOrigin()) + spacing * np.array(data.GetExtent())[::2]
    if on_cells:  # a cell's value belongs to its centre
        points, origin = points - 1, origin + spacing / 2
    values = _values(data, name, on_cells).reshape(points[::-1])
    return checked_grid(values, spacing, origin, nan, outside=None if absent is None else absent.reshape(points[::-1]))


def _from_rectilinear(data: Any, name: str, on_cells: bool, nan: str) -> Grid:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    axes = [vtk_to_numpy(get()) for get in (data.GetXCoordinates, data.GetYCoordinates, data.GetZCoordinates)]
    if on_cells:
        axes = [(axis[1:] + axis[:-1]) / 2 for axis in axes]
    values = _values(data, name, on_cells).reshape([len(axis) for axis in reversed(axes)])
    return _on_axes(values, axes, name, "rectilinear grid", nan)


def _on_axes(values: NDArray[Any], axes: Sequence[NDArray[Any]], name: str, kind: str, nan: str) -> Grid:
    """Values (z, y, x) at the coordinates `axes` along x, y and z: as they are where these are evenly spaced, else resampled."""
    from scipy.interpolate import RegularGridInterpolator

    if min(values.shape) < 2:  # refused by the grid, which names the shape
        return checked_grid(values, 1.0, 0.0, nan)
    for letter, axis in zip("xyz", axes, strict=True):
        if not (np.diff(axis) > 0).all():
            raise ValueError(f"the {kind}'s {letter} coordinates must increase strictly")
    rounding = [4 * np.finfo(axis.dtype).eps * np.abs(axis).max() if axis.dtype.kind == "f" else 0.0 for axis in axes]
    axes = [axis.astype(np.float64) for axis in axes]
    steps = [np.diff(axis) for axis in axes]
    origin = [axis[0] for axis in axes]
    if all(np.ptp(s) <= UNIFORM * s.mean() + slack for s, slack in zip(steps, rounding, strict=True)):
        return checked_grid(values, [step.mean() for step in steps], origin, nan)
    counts = [_samples_along(axis[-1] - axis[0], float(step.min())) for axis, step in zip(axes, steps, strict=True)]
    fine = [np.linspace(axis[0], axis[-1], count) for axis, count in zip(axes, counts, strict=True)]
    interpolate = RegularGridInterpolator(axes[::-1], values.astype(np.float64))
    resampled = np.stack(
        [interpolate(np.stack(np.meshgrid([z], fine[1], fine[0], indexing="ij"), axis=-1))[0] for z in fine[2]]
    )  # [nz, ny, nx]
    nx, ny, nz = counts
    note = (
        f"the {kind} is unevenly spaced: {f'array {name!r}' if name else 'it'} was resampled from "
        f"{' x '.join(str(len(axis)) for axis in axes)} to {nx} x {ny} x {nz} samples (trilinear)"
        + _coarser([float(step.min()) for step in steps], [f[1] - f[0] for f in fine])
    )
    return checked_grid(resampled, [f[1] - f[0] for f in fine], origin, nan, notes=(note,))


def _of_mesh(data: list[Any], kind: str, name: str, on_cells: bool, nan: str) -> Grid:
    """A grid of data sets whose cells make one mesh: the values of boxes in rows as they are, others resampled."""
    if max(block.GetMaxSpatialDimension() for block in data) < 3:
        raise TypeError(f"the {kind} has no volume cells, only surfaces, lines or points")
    mesh = joined(data)
    if not mesh.GetNumberOfCells():
        raise ValueError(f"the {kind} has no cells but ghosts and hidden ones")
    check_types(mesh, on_cells)
    values = _values(mesh, name, on_cells)
    filled = lattice(mesh, values, on_cells)
    if filled is not None and min(filled[0].shape) > 1:
        return _on_axes(*filled, name, kind, nan)
    return _probed(mesh, kind, name, values if on_cells else None, nan)


def _probed(mesh: Any, kind: str, name: str, of_cells: NDArray[Any] | None, nan: str) -> Grid:
    """A grid of the point array of a vtkUnstructuredGrid, or of the values `of_cells` [C]."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkResampleToImage

    bounds = np.array(mesh.GetBounds()).reshape(3, 2)  # [3, 2]
    extent = bounds[:, 1] - bounds[:, 0]  # [3]
    typical = float((extent.prod() / mesh.GetNumberOfCells()) ** (1 / 3))  # edge of a cell of mean size
    edges = [edge if edge < THIN * typical else typical for edge in edges_along_axes(mesh, 1 / MOST_SAMPLES)]
    counts = [_samples_along(length, edge) for length, edge in zip(extent, edges, strict=True)]
    sampled, method = name, "interpolated linearly in each cell"
    if of_cells is not None:
        sampled, method = "vtkCell", "linear in each cell around its centre"
    is_corrected = of_cells is None and add_places(mesh, name)
    resample = vtkResampleToImage()
    resample.SetInputDataObject(divided(mesh))
    resample.SetUseInputBounds(True)
    resample.SetSamplingDimensions(*counts)
    resample.Update()
    image = resample.GetOutput()
    values = vtk_to_numpy(image.GetPointData().GetArray(sampled)).reshape(counts[::-1])
    outside = vtk_to_numpy(image.GetPointData().GetArray("vtkValidPointMask")).reshape(counts[::-1]) == 0
    points = image.GetOrigin() + np.argwhere(~outside)[:, ::-1] * np.array(image.GetSpacing())  # [N, 3]
    if is_corrected:
        place, slope = (vtk_to_numpy(image.GetPointData().GetArray(part)) for part in ("vtkPlace", "vtkSlope"))
        values = values.astype(np.float64)
        values[~outside] += np.sum((points - place[~outside.ravel()]) * slope[~outside.ravel()], axis=1)
    if of_cells is not None:
        cells, values = values[~outside], np.zeros(values.shape)
        values[~outside] = reconstructed(mesh, of_cells.astype(np.float64), cells, points)
    nx, ny, nz = counts
    note = (
        f"the {kind} of {mesh.GetNumberOfCells()} cells is not a regular grid: array {name!r} was "
        f"resampled to {nx} x {ny} x {nz} samples ({method}); {outside.mean():.1%} of them lie outside its cells "
        "and are transparent" + _coarser(edges, list(np.array(image.GetSpacing())))
    )
    return checked_grid(values, image.GetSpacing(), image.GetOrigin(), nan, outside=outside, notes=(note,))


def _values(data: Any, name: str, on_cells: bool) -> NDArray[Any]:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy((data.GetCellData() if on_cells else data.GetPointData()).GetArray(name))


def _scalar_names(attributes: Any) -> list[str]:
    """Names of the numeric arrays, without VTK's own bookkeeping (ghost flags, ids)."""
    arrays = [attributes.GetArray(i) for i in range(attributes.GetNumberOfArrays())]
    names = [one.GetName() for one in arrays if one is not None and one.GetName()]
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
