"""The one call that turns a field into pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from numpy.typing import NDArray

from catalogs.appearance import Appearance, Isosurface, VolumeRendering
from catalogs.cameras import Camera
from render.grids import Grid
from render.isosurface import IsosurfaceRenderer
from render.volume import VolumeRenderer


def renderer(
    grid: Grid, appearance: Appearance, *, sample_distance: float | None = None
) -> VolumeRenderer | IsosurfaceRenderer:
    """An open renderer (a context manager with `render(camera)`) of `grid` under `appearance`."""
    if isinstance(appearance, VolumeRendering):
        return VolumeRenderer(grid, appearance, sample_distance=sample_distance)
    if isinstance(appearance, Isosurface):
        return IsosurfaceRenderer(grid, appearance)
    raise TypeError(f"{type(appearance).__name__} {appearance.name!r} cannot be rendered from a field")


def render_views(
    grid: Grid,
    appearance: Appearance,
    cameras: Iterable[Camera],
    *,
    sample_distance: float | None = None,
    float_output: bool = False,
) -> Iterator[NDArray[Any]]:
    """Premultiplied RGBA pictures [height, width, 4], top row first, one per camera, in order.

    uint8, or float32 in [0, 1] with `float_output`.  `sample_distance` (world units) is for volumes: by default
    half the smallest spacing (`choose_sample_distance` finds the largest that is good enough).  The field is
    uploaded once and freed when the iterator ends or is closed.
    """
    with renderer(grid, appearance, sample_distance=sample_distance) as scene:
        for camera in cameras:
            yield scene.render(camera, float_output=float_output)
