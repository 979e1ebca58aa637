"""Pictures by the ray caster of `native`, which needs no OpenGL."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import to_bytes
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native.threads import cores
from render.grids import Grid

if TYPE_CHECKING:
    from native.ray_casting import SurfaceCaster, VolumeCaster


def prepared(grid: Grid, appearance: VolumeRendering | Isosurface) -> VolumeCaster | SurfaceCaster:
    """A field under an appearance, ready for many views and sample distances."""
    from native.ray_casting import SampledField, SurfaceCaster, VolumeCaster

    field = SampledField(grid.values, grid.holes, grid.spacing, grid.origin, is_filled=True)
    if isinstance(appearance, VolumeRendering):
        return VolumeCaster.of(field, appearance, threads=drawing_threads())
    return SurfaceCaster.of(field, appearance)


def cast_views(
    caster: VolumeCaster | SurfaceCaster,
    cameras: Iterable[Camera],
    sample_distance: float | None,
    *,
    float_output: bool,
) -> Iterator[NDArray[Any]]:
    """Pictures as `render.render_views` has them, bitwise the same for any number of threads."""
    from native.ray_casting import VolumeCaster

    threads = drawing_threads()
    if isinstance(caster, VolumeCaster):
        caster = caster.at(sample_distance)
    for camera in cameras:
        picture: NDArray[np.float32] = caster.draw(camera, threads=threads)
        yield picture if float_output else to_bytes(picture)


def drawing_threads() -> int:
    """Threads to draw with: those that LP_NUM_THREADS allows, as for VTK's software OpenGL, else one for each core."""
    limit = os.environ.get("LP_NUM_THREADS", "")
    return max(1, int(limit)) if limit.isdecimal() else cores()
