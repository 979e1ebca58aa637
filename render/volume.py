"""Direct volume rendering with VTK's GPU ray-caster (which Mesa runs on a CPU just as well)."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import TransferFunction, VolumeRendering
from catalogs.cameras import Camera
from render.grids import Grid
from render.placement import Placement
from render.shaders import replacements
from render.window import aim, open_window

FARTHEST = 1e6  # widths of the transfer function


class VolumeRenderer:
    """Pictures of one field under one transfer function: upload once, draw many views, free on exit.

    VTK draws the volume's box and holds its texture; the ray-caster's inner loop is `render.shaders`.

    Parameters
    ----------
    sample_distance : longest distance between samples along a ray, world units (each ray is cut into equal
        steps no longer than this); by default half the smallest spacing.

    Shaded volumes are lit by a headlight at the eye, two-sided, by central differences of the field.
    """

    def __init__(
        self,
        grid: Grid,
        appearance: VolumeRendering,
        *,
        sample_distance: float | None = None,
    ) -> None:
        distance = default_sample_distance(grid) if sample_distance is None else float(sample_distance)
        if not (np.isfinite(distance) and distance > 0):
            raise ValueError(f"sample_distance must be a positive length in world units, got {sample_distance}")
        self.sample_distance = distance
        self._placement = Placement.of(grid)
        self._window = open_window()
        if max(grid.shape) > self._window.longest_volume:
            raise ValueError(
                f"the grid has {max(grid.shape)} samples along one axis, but this machine's OpenGL takes "
                f"{self._window.longest_volume}: render every second sample (field[::2, ::2, ::2], spacing doubled)"
            )
        self._renderer: Any = _volume_scene(grid, appearance, self._placement, distance)
        self._window.add(self._renderer)

    def render(self, camera: Camera, *, float_output: bool = False) -> NDArray[Any]:
        """Premultiplied RGBA [height, width, 4], top row first: uint8, or float32 in [0, 1]."""
        if self._renderer is None:
            raise RuntimeError("this renderer is closed")
        local = self._placement.camera(camera)
        aim(self._renderer, local, *self._placement.clipping_range(local))
        return self._window.draw(self._renderer, camera.width, camera.height, float_output=float_output)

    def close(self) -> None:
        """Free the volume, here and in graphics memory."""
        if self._renderer is not None:
            self._window.remove(self._renderer)
            self._renderer = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def default_sample_distance(grid: Grid) -> float:
    """Half the smallest spacing, world units."""
    return 0.5 * min(grid.spacing)


def _volume_scene(grid: Grid, appearance: VolumeRendering, placement: Placement, distance: float) -> Any:
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkVolume
    from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper

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
