"""Isosurfaces of a field: triangles, drawn by C++ kernels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import Camera
from native import kernels
from native.ray_casting.fields import SampledField
from native.ray_casting.triangles import Triangles
from native.threads import cores

SAMPLES = 4  # along each side of a pixel


@dataclass(frozen=True, eq=False)
class SurfaceCaster:
    """An isosurface of a field, prepared for many views.

    Attributes
    ----------
    field : the samples.
    appearance : isovalue, colour and light.
    triangles : the surface.

    Examples
    --------
    >>> from blobs import CAMERA, PLACE, simulate
    >>> from catalogs import Isosurface
    >>> from native.ray_casting import SampledField, SurfaceCaster
    >>> caster = SurfaceCaster.of(SampledField(simulate(0.8, 0.3), **PLACE), Isosurface("half", 0.5))
    >>> [caster.draw(CAMERA.resized(size, size)).shape for size in (32, 64)]
    [(32, 32, 4), (64, 64, 4)]
    """

    field: SampledField
    appearance: Isosurface
    triangles: Triangles

    @classmethod
    def of(cls, field: SampledField, appearance: Isosurface) -> SurfaceCaster:
        """Raises TypeError for another kind of appearance."""
        if not isinstance(appearance, Isosurface):
            raise TypeError(f"a surface is drawn by an Isosurface, got {type(appearance).__name__}")
        return cls(field, appearance, Triangles.of(field, appearance.isovalue))

    def within(self, bounds: NDArray[np.float64]) -> SurfaceCaster:
        """The same with triangles cut to places (2, 3) in samples."""
        return replace(self, triangles=self.triangles.within(bounds))

    def draw(self, camera: Camera, *, samples: int = SAMPLES, threads: int | None = None) -> NDArray[np.float32]:
        """Premultiplied RGBA (height, width, 4), top row first; bitwise the same for any number of threads.

        `samples` lie along each side of a pixel: 1, 2 or 4.
        """
        surface, size = self.appearance, (samples * camera.width, samples * camera.height)
        return kernels.draw_surface(
            self.triangles.places,
            self.triangles.normals,
            self.triangles.corners,
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

    The surface consists of triangles as `render` has them, its normals are the field's gradients by central differences; pixels
    are the mean of 4 x 4 samples.  `SurfaceCaster` draws several views of one surface faster.

    Parameters
    ----------
    values : (nz, ny, nx) real, finite but in holes; sample [k, j, i] lies at `origin + spacing * (i, j, k)`.
    holes : (nz, ny, nx) bool or None, samples without a value: grid cells with one at a corner have no surface.
    spacing, origin : world units, in the order x, y, z.
    threads : by default all cores.

    Examples
    --------
    >>> from blobs import CAMERA, PLACE, simulate
    >>> from catalogs import Isosurface
    >>> from native.ray_casting import draw_isosurface
    >>> draw_isosurface(simulate(0.8, 0.3), None, **PLACE, appearance=Isosurface("half", 0.5), camera=CAMERA).shape
    (128, 128, 4)
    """
    field = SampledField(values, holes, spacing, origin)  # type: ignore[arg-type]
    return SurfaceCaster.of(field, appearance).draw(camera, threads=threads)
