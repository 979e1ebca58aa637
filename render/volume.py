"""Direct volume rendering with VTK's GPU ray-caster (which Mesa runs on a CPU just as well)."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import TransferFunction, VolumeRendering
from catalogs.cameras import Camera
from render.grids import Grid
from render.window import Window, aim, clipping_range, open_window

# VTK's stock shader takes its first sample a whole step inside the volume; the midpoint rule wants half a step.
HALF_STEP = ("//VTK::Base::Init", "//VTK::Base::Init\n  g_rayOrigin -= 0.5 * g_dirStep;\n")


class VolumeRenderer:
    """Pictures of one field under one transfer function: upload once, draw many views, free on exit.

    Parameters
    ----------
    sample_distance : distance between samples along a ray, world units; by default half the smallest spacing.
    half_step : sample at the middle of each step (midpoint rule) instead of at its end as stock VTK does.

    Values are clamped to the transfer function's range and mapped to [0, 1] before VTK sees them, because its
    lookup tables span the range of the data and lose the transfer function in data far wider than it.
    """

    def __init__(
        self,
        grid: Grid,
        appearance: VolumeRendering,
        *,
        sample_distance: float | None = None,
        half_step: bool = True,
        window: Window | None = None,
    ) -> None:
        distance = default_sample_distance(grid) if sample_distance is None else float(sample_distance)
        if not (np.isfinite(distance) and distance > 0):
            raise ValueError(f"sample_distance must be a positive length in world units, got {sample_distance}")
        self.sample_distance = distance
        self._bounds = grid.bounds
        self._window = window or open_window()
        self._renderer = _volume_scene(grid, appearance, distance, half_step)
        self._window.add(self._renderer)

    def render(self, camera: Camera, *, float_output: bool = False) -> NDArray[Any]:
        """Premultiplied RGBA [height, width, 4], top row first: uint8, or float32 in [0, 1]."""
        aim(self._renderer, camera, *clipping_range(camera, self._bounds))
        return self._window.draw(self._renderer, camera.width, camera.height, float_output=float_output)

    def close(self) -> None:
        """Free the volume, here and in graphics memory."""
        if self._renderer is not None:
            self._window.remove(self._renderer)
            self._renderer = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def default_sample_distance(grid: Grid) -> float:
    """Half the smallest spacing, world units."""
    return 0.5 * min(grid.spacing)


def _volume_scene(grid: Grid, appearance: VolumeRendering, distance: float, half_step: bool) -> Any:
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkVolume
    from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper

    mapper = vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetInputData(image_data(_normalized(grid.values, appearance.transfer_function), grid))
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetLockSampleDistanceToInputSpacing(False)
    mapper.SetUseJittering(False)
    mapper.SetSampleDistance(distance)
    volume = vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(_volume_property(appearance))
    if half_step:
        volume.GetShaderProperty().AddFragmentShaderReplacement(HALF_STEP[0], True, HALF_STEP[1], False)
    renderer = vtkRenderer()
    renderer.AddVolume(volume)
    return renderer


def _volume_property(appearance: VolumeRendering) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkVolumeProperty

    transfer = appearance.transfer_function
    low, high = transfer.bounds
    colors, opacities = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for value, *rgb in transfer.color_points:
        colors.AddRGBPoint((value - low) / (high - low), *rgb)
    for value, opacity in transfer.opacity_points:
        opacities.AddPoint((value - low) / (high - low), opacity)
    form = vtkVolumeProperty()
    form.SetColor(colors)
    form.SetScalarOpacity(opacities)
    form.SetScalarOpacityUnitDistance(transfer.opacity_unit_distance)
    form.SetInterpolationTypeToLinear()
    form.SetShade(appearance.shaded)
    return form


def _normalized(values: NDArray[np.float32], transfer: TransferFunction) -> NDArray[np.float32]:
    """`values` with the transfer function's range mapped to [0, 1], and clamped to it."""
    low, high = transfer.bounds
    scaled = np.empty_like(values)
    for plane, source in zip(scaled, values, strict=True):  # float64 for one plane at a time
        plane[...] = (np.clip(source.astype(np.float64), low, high) - low) / (high - low)
    return scaled


def image_data(values: NDArray[np.float32], grid: Grid) -> Any:
    """`values` (nz, ny, nx) as a vtkImageData that shares their memory, placed like `grid`."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    image.SetDimensions(*values.shape[::-1])
    image.SetSpacing(*grid.spacing)
    image.SetOrigin(*grid.origin)
    image.GetPointData().SetScalars(numpy_to_vtk(values.reshape(-1)))
    return image
