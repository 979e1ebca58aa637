"""Direct volume rendering with VTK's GPU ray-caster (which Mesa runs on a CPU just as well)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import VolumeRendering
from native.ray_casting.functions import drawn_range
from render.grids import Grid
from render.placement import Placement
from render.shaders import equal_steps, replacements, steps_of_whole
from render.window import open_window

FARTHEST = 1e6  # widths of the drawn range


def volume_scene(
    grid: Grid,
    appearance: VolumeRendering,
    placement: Placement,
    sample_distance: float | None = None,
    *,
    value_range: tuple[float, float] | None = None,
    block: bool = False,
) -> Any:
    """A vtkRenderer that shows the volume; VTK draws its box and holds its texture, `render.shaders` is the inner loop.

    `sample_distance` is the longest distance between samples along a ray, world units (each ray is cut into equal steps
    no longer than this); by default half the smallest spacing.  Shaded volumes are lit by a headlight at the eye,
    two-sided, by central differences of the field.  `value_range` is by default the grid's `drawn_range`.

    A `block` is drawn as its part of the whole in whose box `placement` puts it: with the samples of rays that lie in the space
    which it owns.  That space and the camera must be handed to the shader (`render.shaders.tell_rays`).

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
    value_range = drawn_range(grid.range, appearance.transfer_function) if value_range is None else value_range
    mapper = vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetInputData(image_data(texture_values(grid, value_range), placement))
    if grid.holes is not None:
        mapper.SetMaskInput(image_data(hidden_cells(grid.holes), placement))
        mapper.SetMaskTypeToBinary()
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetLockSampleDistanceToInputSpacing(False)
    mapper.SetUseJittering(False)
    mapper.SetSampleDistance(distance / placement.scale)
    volume = vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(_plain_property(appearance.shaded))
    shader = volume.GetShaderProperty()
    steps = equal_steps() if not block else steps_of_whole(grid.shape, placement, distance / placement.scale)
    transfer, holes = appearance.transfer_function, grid.holes is not None
    code = replacements(transfer, value_range, placement.scale, shaded=appearance.shaded, holes=holes, steps=steps)
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


def texture_values(grid: Grid, value_range: tuple[float, float]) -> NDArray[np.float32]:
    """Samples (nz, ny, nx, 1) as `render.shaders.replacements` expects them, scaled in float64.

    The `value_range` becomes 0 to 1.  Values beyond it stay beyond, because interpolation comes before clamping.  They end at
    `FARTHEST`, so that single precision never overflows in between.  That moves the place where an interpolated value enters the
    range by less than a millionth of a grid cell.
    """
    low, high = value_range
    texture = np.empty((*grid.shape, 1), dtype=np.float32)
    with np.errstate(over="ignore"):
        for plane, differences in zip(texture, grid.minus(low), strict=True):  # float64 for one plane at a time
            plane[..., 0] = np.clip(differences / (high - low), -FARTHEST, FARTHEST)
    return texture


def hidden_cells(holes: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """1 where a grid cell has a hole at a corner, (nz, ny, nx, 1) by its first corner; the last of each axis begins none."""
    hidden = holes.astype(np.uint8)
    for axis in range(3):
        first, second = (np.moveaxis(hidden, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
        for one, other in zip(first, second, strict=True):  # in place, in order: `other` is not yet changed
            np.maximum(one, other, out=one)
    return hidden[..., None]


def image_data(values: NDArray[Any], placement: Placement) -> Any:
    """`values` (nz, ny, nx, components) as a vtkImageData that shares their memory, in the unit sphere."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    image.SetDimensions(*values.shape[2::-1])
    image.SetSpacing(*placement.spacing)
    image.SetOrigin(*placement.origin)
    image.GetPointData().SetScalars(numpy_to_vtk(values.reshape(-1, values.shape[3])))
    return image
