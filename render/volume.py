"""Direct volume rendering with VTK's GPU ray-caster (which Mesa runs on a CPU just as well)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import TransferFunction, VolumeRendering
from render.grids import Grid
from render.placement import Placement
from render.shaders import replacements
from render.window import open_window

FARTHEST = 1e6  # widths of the transfer function


def volume_scene(
    grid: Grid, appearance: VolumeRendering, placement: Placement, sample_distance: float | None = None
) -> Any:
    """A vtkRenderer that shows the volume; VTK draws its box and holds its texture, `render.shaders` is the inner loop.

    `sample_distance` is the longest distance between samples along a ray, world units (each ray is cut into equal steps
    no longer than this); by default half the smallest spacing.  Shaded volumes are lit by a headlight at the eye,
    two-sided, by central differences of the field.

    Raises ValueError for a distance that is none and for a grid too long for this machine's OpenGL.
    """
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkVolume
    from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper

    distance = 0.5 * min(grid.spacing) if sample_distance is None else float(sample_distance)
    if not (np.isfinite(distance) and distance > 0):
        raise ValueError(f"sample_distance must be a positive length in world units, got {sample_distance}")
    longest = open_window().longest_volume
    if max(grid.shape) > longest:
        raise ValueError(
            f"the grid has {max(grid.shape)} samples along one axis, but this machine's OpenGL takes "
            f"{longest}: render every second sample (field[::2, ::2, ::2], spacing doubled)"
        )
    mapper = vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetInputData(image_data(texture_values(grid, appearance.transfer_function), placement))
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetLockSampleDistanceToInputSpacing(False)
    mapper.SetUseJittering(False)
    mapper.SetSampleDistance(distance / placement.scale)
    volume = vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(_plain_property(appearance.shaded))
    shader = volume.GetShaderProperty()
    code = replacements(
        appearance.transfer_function, placement.scale, shaded=appearance.shaded, holes=grid.holes is not None
    )
    for tag, replacement in code.items():
        shader.AddFragmentShaderReplacement(tag, True, replacement, False)
    renderer = vtkRenderer()
    renderer.AddVolume(volume)
    return renderer


def _plain_property(shaded: bool) -> Any:
    """Linear interpolation; the colours are the shader's, but VTK wants a transfer function to exist."""
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkVolumeProperty

    form = vtkVolumeProperty()
    form.SetColor(vtkColorTransferFunction())
    form.SetScalarOpacity(vtkPiecewiseFunction())
    form.SetInterpolationTypeToLinear()
    form.SetShade(shaded)
    return form


def texture_values(grid: Grid, transfer: TransferFunction) -> NDArray[np.float32]:
    """Samples (nz, ny, nx, 1 or 2) as `render.shaders.replacements` expects them.

    The transfer function's bounds become 0 and 1.  Values beyond them stay beyond, because interpolation comes
    before clamping, but no further than `FARTHEST`, so that single precision never overflows in between.
    """
    low, high = transfer.bounds
    texture = np.zeros((*grid.shape, 1 if grid.holes is None else 2), dtype=np.float32)
    for plane, values in zip(texture, grid.values, strict=True):  # float64 for one plane at a time
        plane[..., 0] = np.clip((values.astype(np.float64) - low) / (high - low), -FARTHEST, FARTHEST)
    if grid.holes is not None:
        texture[..., 1] = grid.holes
    return texture


def image_data(values: NDArray[np.float32], placement: Placement) -> Any:
    """`values` (nz, ny, nx, components) as a vtkImageData that shares their memory, in the unit sphere."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    image.SetDimensions(*values.shape[2::-1])
    image.SetSpacing(*placement.spacing)
    image.SetOrigin(*placement.low)
    image.GetPointData().SetScalars(numpy_to_vtk(values.reshape(-1, values.shape[3])))
    return image
