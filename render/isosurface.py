"""Isosurfaces: extracted once per member, drawn from every view."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Isosurface
from render.grids import Grid
from render.placement import Placement
from render.volume import hidden_cells, image_data

# VTK squares gradients in float32.  Within these bounds neither the square overflows on the longest grid, nor does it vanish.
LARGEST, SMALLEST = 1e15, 1e-8
SUPERSAMPLING = 4  # pixels are the mean of SUPERSAMPLING**2

# Blinn-Phong with light and eye in one direction (a headlight at the eye), seen from both sides.
HEADLIGHT = """
  float facing = abs(dot(normalize(normalVCVSOutput), normalize(vertexVC.xyz)));
  vec3 shade = ({ambient:.9e} + {diffuse:.9e} * facing) * vec3({red:.9e}, {green:.9e}, {blue:.9e})
    + vec3({specular:.9e} * pow(facing, {specular_power:.9e}));
  gl_FragData[0] = vec4(clamp(shade, 0.0, 1.0), 1.0);
"""


def surface_scene(
    grid: Grid, appearance: Isosurface, placement: Placement, left_out: NDArray[np.bool_] | None = None
) -> Any:
    """A vtkRenderer that shows the isosurface, but in grid cells `left_out` (see `extract`); None where the field has none."""
    from vtkmodules.vtkRenderingCore import vtkActor, vtkLight, vtkPolyDataMapper, vtkRenderer

    surface = extract(grid, appearance.isovalue, placement, left_out)
    if not surface.GetNumberOfPolys():
        return None
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(surface)
    mapper.ScalarVisibilityOff()
    actor = vtkActor()
    actor.SetMapper(mapper)
    red, green, blue = appearance.color
    code = HEADLIGHT.format(**vars(appearance), red=red, green=green, blue=blue)
    actor.GetShaderProperty().AddFragmentShaderReplacement("//VTK::Light::Impl", True, code, False)
    light = vtkLight()  # a positional one makes VTK hand positions and normals to the fragment shader
    light.SetLightTypeToHeadlight()
    light.PositionalOn()
    renderer = vtkRenderer()
    renderer.AddLight(light)
    renderer.AddActor(actor)
    return renderer


def extract(grid: Grid, isovalue: float, placement: Placement, left_out: NDArray[np.bool_] | None = None) -> Any:
    """The surface as vtkPolyData: triangles with point normals, in the unit sphere of `placement`.

    The flying-edges triangulation (Schroeder, Maynard & Geveci 2015) with normals from central differences.  Grid cells with a
    hole at a corner have none, nor have those `left_out`, (nz, ny, nx) by their first corner.
    """
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    values, level = single_precision(grid, isovalue)
    contour = vtkFlyingEdges3D()
    contour.SetInputData(image_data(values[..., None], placement))
    contour.SetValue(0, level)
    contour.ComputeNormalsOn()
    contour.ComputeGradientsOff()
    contour.ComputeScalarsOff()
    contour.Update()
    surface = contour.GetOutput()
    if grid.holes is not None:
        hidden = hidden_cells(grid.holes)[..., 0] > 0
        left_out = hidden if left_out is None else hidden | left_out
    if left_out is not None and surface.GetNumberOfPolys():
        surface = _without_cells(surface, left_out, placement)
    return surface


def single_precision(grid: Grid, isovalue: float) -> tuple[NDArray[np.float32], float]:
    """(samples, level) with the isosurface of `grid` at `isovalue`, in float32 numbers near 1.

    float32 samples of ordinary size are taken as they are.  Otherwise the isovalue is subtracted in float64, and the
    difference is divided by a power of two, the nearest to the geometric mean of the field's steps across the surface.  That moves
    no point of the surface and turns no normal.  Samples further than `LARGEST` such steps are held there.
    """
    if grid.values.dtype == np.float32:
        exponent = 0.0 if abs(isovalue) > SMALLEST else _step_exponent(grid, isovalue)
        if max(map(abs, grid.range)) < LARGEST and exponent > math.log2(SMALLEST):
            return grid.values, isovalue
    exponent = round(_step_exponent(grid, isovalue))
    samples = np.empty(grid.shape, dtype=np.float32)
    with np.errstate(over="ignore"):
        for plane, differences in zip(samples, grid.minus(isovalue), strict=True):
            plane[...] = np.clip(np.ldexp(differences, -exponent), -LARGEST, LARGEST)
    return samples, 0.0


def _step_exponent(grid: Grid, isovalue: float) -> float:
    """log2 of the field's steps over the grid's edges that cross the surface, their mean; 0 where none does."""
    total, count, before = 0.0, 0, None
    for plane in grid.minus(isovalue):
        pairs = [(plane[1:], plane[:-1]), (plane[:, 1:], plane[:, :-1])]
        for first, second in pairs if before is None else [*pairs, (plane, before)]:
            cut = (first >= 0.0) != (second >= 0.0)
            larger = np.maximum(np.abs(first[cut]), np.abs(second[cut]))  # at least half the step
            total, count = total + float(np.log2(larger).sum()), count + larger.size
        before = plane
    return total / count if count else 0.0


def box_average(image: NDArray[Any], n: int) -> NDArray[Any]:
    """`image` [n H, n W, 4] -> [H, W, 4], the mean over n x n pixels; uint8 (n up to 16) is rounded to the nearest."""
    rows = _sum([image[first::n] for first in range(n)])  # [H, n W, 4]
    total = _sum([rows[:, first::n] for first in range(n)])  # [H, W, 4]
    if image.dtype == np.uint8:
        return ((total + n * n // 2) // (n * n)).astype(np.uint8)
    return np.asarray(total / np.float32(n * n))


def _sum(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The sum of equal-shaped arrays, of bytes in 16 bits: numpy's own over an axis of a few entries is far slower."""
    total = parts[0].astype(np.uint16 if parts[0].dtype == np.uint8 else parts[0].dtype)
    for part in parts[1:]:
        total += part
    return total


def _without_cells(surface: Any, left_out: NDArray[np.bool_], placement: Placement) -> Any:
    """`surface` without the triangles in some grid cells (each triangle lies in one cell)."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    points = vtk_to_numpy(surface.GetPoints().GetData())  # [P, 3]
    triangles = vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)  # [T, 3]
    middles = points[triangles].mean(axis=1, dtype=np.float64)  # [T, 3]
    cells = ((middles - placement.origin) / placement.spacing).astype(np.int64)  # [T, 3] as x, y, z
    cells = np.clip(cells, 0, np.array(left_out.shape[::-1]) - 2)
    remaining = triangles[~left_out[tuple(cells[:, ::-1].T)]]
    polygons = vtkCellArray()
    polygons.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(remaining, dtype=np.int64).reshape(-1), deep=True))
    left = vtkPolyData()
    left.SetPoints(surface.GetPoints())
    left.SetPolys(polygons)
    left.GetPointData().SetNormals(surface.GetPointData().GetNormals())
    return left
