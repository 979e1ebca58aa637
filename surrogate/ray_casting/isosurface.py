"""Isosurfaces of a field by the C++ ray caster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import Camera
from surrogate import kernels
from surrogate.ray_casting.fields import SampledField
from surrogate.splatting.threads import cores

SAMPLES = 4  # along each side of a pixel
LOOKED_AT = 4096  # values of a field, for their scale


@dataclass(frozen=True, eq=False)
class SurfaceCaster:
    """An isosurface of a field, prepared for many views.

    Attributes
    ----------
    field : the samples.
    appearance : isovalue, colour and light.
    """

    field: SampledField
    appearance: Isosurface
    _samples: kernels.CastField

    @classmethod
    def of(cls, field: SampledField, appearance: Isosurface, *, threads: int | None = None) -> SurfaceCaster:
        """Raises TypeError for another kind of appearance."""
        if not isinstance(appearance, Isosurface):
            raise TypeError(f"a surface is drawn by an Isosurface, got {type(appearance).__name__}")
        values, within = values_about(field, appearance.isovalue)
        samples = kernels.cast_field(values, field.holes, *within, True, cores() if threads is None else threads)
        return cls(field, appearance, samples)

    def draw(self, camera: Camera, *, samples: int = SAMPLES, threads: int | None = None) -> NDArray[np.float32]:
        """Premultiplied RGBA (height, width, 4), top row first; bitwise the same for any number of threads.

        `samples` lie along each side of a pixel: 1, 2 or 4.
        """
        surface, size = self.appearance, (samples * camera.width, samples * camera.height)
        return kernels.cast_surface(
            self._samples,
            surface.color,
            (surface.ambient, surface.diffuse, surface.specular, surface.specular_power),
            samples,
            self.field.rays(camera.resized(*size)),
            size,
            cores() if threads is None else threads,
        )


def draw_isosurface(
    values: NDArray[Any],
    holes: NDArray[np.bool_] | None,
    spacing: ArrayLike,
    origin: ArrayLike,
    appearance: Isosurface,
    camera: Camera,
    *,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """The isosurface of a field, lit as `render.render_views` does: premultiplied RGBA (height, width, 4), top row first.

    The surface is that of the trilinear field, its normals are the field's gradients by central differences; pixels are the
    mean of 4 x 4 samples.  `render` draws triangles, which lie within the same grid cells.  Pieces thinner than a quarter of
    a sample may be missed.  `SurfaceCaster` draws several views of one surface faster.

    Parameters
    ----------
    values : (nz, ny, nx) real, finite but in holes; sample [k, j, i] lies at `origin + spacing * (i, j, k)`.
    holes : (nz, ny, nx) bool or None, samples without a value: grid cells with one at a corner have no surface.
    spacing, origin : world units, in the order x, y, z.
    threads : by default all cores.
    """
    field = SampledField(values, holes, spacing, origin)  # type: ignore[arg-type]
    return SurfaceCaster.of(field, appearance, threads=threads).draw(camera, threads=threads)


def values_about(field: SampledField, isovalue: float) -> tuple[NDArray[np.float32], tuple[float, float]]:
    """(values (nz, ny, nx), those of them that become 0 and 1): the isovalue, and one further by the median distance from it."""
    values = field.filled
    some = values.reshape(-1)[:: max(1, values.size // LOOKED_AT)]
    with np.errstate(over="ignore"):
        distances = np.abs(some.astype(np.float64) - isovalue)
    distances = distances[distances > 0.0]
    scale = float(np.clip(np.median(distances), 1e-300, 1e300)) if distances.size else 1.0
    if values.dtype == np.float32 and isovalue + scale > isovalue:
        return values, (isovalue, isovalue + scale)
    with np.errstate(over="ignore"):
        scaled = (values.astype(np.float64) - isovalue) / scale
    return np.clip(scaled, -1e30, 1e30).astype(np.float32), (0.0, 1.0)
