"""Volume renderings of a field by the C++ ray caster."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import positive
from native import kernels
from native.ray_casting.fields import SampledField
from native.ray_casting.functions import Knots, drawn_range
from native.threads import cores

HEADLIGHT = (0.1, 0.7, 0.2, 10.0)  # ambient, diffuse, specular and its power, of shaded volumes
MOST_STEPS = 1 << 20  # along the box's diagonal


@dataclass(frozen=True, eq=False)
class VolumeCaster:
    """A field under a volume rendering, prepared for many views.

    Attributes
    ----------
    field : the samples.
    appearance : transfer function and shading.
    sample_distance : the longest distance between samples along a ray, world units; each ray is cut into equal steps, and the
        field is sampled in the middle of each.
    bounds : the lowest and highest place, (2, 3) in samples, where rays begin and end; None for the field's own.

    Examples
    --------
    >>> from blobs import APPEARANCE, CAMERA, PLACE, simulate
    >>> from native.ray_casting import SampledField, VolumeCaster
    >>> caster = VolumeCaster.of(SampledField(simulate(0.8, 0.3), **PLACE), APPEARANCE)
    >>> [caster.draw(CAMERA.resized(size, size)).shape for size in (32, 64)]
    [(32, 32, 4), (64, 64, 4)]
    """

    field: SampledField
    appearance: VolumeRendering
    sample_distance: float
    _samples: kernels.CastField
    _knots: NDArray[np.float64]
    bounds: NDArray[np.float64] | None = None

    @classmethod
    def of(
        cls,
        field: SampledField,
        appearance: VolumeRendering,
        *,
        sample_distance: float | None = None,
        threads: int | None = None,
    ) -> VolumeCaster:
        """By default samples are half the smallest spacing apart, as `render` has them.

        Raises TypeError for another kind of appearance, ValueError for a distance that no ray can be cut by.
        """
        if not isinstance(appearance, VolumeRendering):
            raise TypeError(f"a volume is drawn by a VolumeRendering, got {type(appearance).__name__}")
        distance = checked_distance(field, sample_distance)
        transfer = appearance.transfer_function
        value_range = drawn_range(field.range, transfer)
        values, within = drawn_values(field, value_range, needs_neighbours=appearance.shaded)
        samples = kernels.cast_field(values, field.holes, *within, cores() if threads is None else threads)
        return cls(field, appearance, distance, samples, Knots.of(transfer, value_range).table(transfer))

    def draw(self, camera: Camera, *, threads: int | None = None) -> NDArray[np.float32]:
        """Premultiplied RGBA (height, width, 4), top row first; bitwise the same for any number of threads."""
        return kernels.cast_volume(
            self._samples,
            self._knots,
            (self.sample_distance, self.appearance.transfer_function.opacity_unit_distance),
            HEADLIGHT if self.appearance.shaded else None,
            self.field.rays(camera),
            (camera.width, camera.height),
            cores() if threads is None else threads,
            self.bounds,
        )

    def at(self, sample_distance: float | None) -> VolumeCaster:
        """The same with samples so far apart, by default half the smallest spacing; raises ValueError as `of` does."""
        return replace(self, sample_distance=checked_distance(self.field, sample_distance))

    def within(self, bounds: NDArray[np.float64]) -> VolumeCaster:
        """The same cut to places (2, 3) inside of the field; nothing is seen where they are equal along an axis."""
        return replace(self, bounds=bounds)


def draw_volume(
    values: NDArray[Any],
    holes: NDArray[np.bool_] | None,
    spacing: ArrayLike,
    origin: ArrayLike,
    appearance: VolumeRendering,
    camera: Camera,
    *,
    sample_distance: float | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """The volume rendering of a field as `render.render_views` draws it: premultiplied RGBA (height, width, 4), top row first.

    Emission and absorption (Max 1995, "Optical models for direct volume rendering", equation 7) by the midpoint rule, the field
    trilinear, opacities and colours exactly piecewise linear.  `VolumeCaster` draws several views of one field faster.

    Parameters
    ----------
    values : (nz, ny, nx) real, finite but in holes; sample [k, j, i] lies at `origin + spacing * (i, j, k)`.
    holes : (nz, ny, nx) bool or None, samples without a value: grid cells with one at a corner are transparent.
    spacing, origin : world units, in the order x, y, z.
    sample_distance : the longest distance between samples along a ray, world units; by default half the smallest spacing.
    threads : by default all cores.

    Examples
    --------
    >>> from blobs import APPEARANCE, CAMERA, PLACE, simulate
    >>> from native.ray_casting import draw_volume
    >>> draw_volume(simulate(0.8, 0.3), None, **PLACE, appearance=APPEARANCE, camera=CAMERA).shape
    (128, 128, 4)
    """
    field = SampledField(values, holes, spacing, origin)  # type: ignore[arg-type]
    caster = VolumeCaster.of(field, appearance, sample_distance=sample_distance, threads=threads)
    return caster.draw(camera, threads=threads)


def checked_distance(field: SampledField, sample_distance: float | None) -> float:
    """World units between samples; raises ValueError for a distance that is not positive or cuts rays into too many steps."""
    if sample_distance is None:
        return 0.5 * min(field.spacing)
    distance = positive(sample_distance, "sample_distance")
    diagonal = float(np.linalg.norm((field.size - 1) * field.spacing))
    if diagonal > MOST_STEPS * distance:
        raise ValueError(
            f"sample_distance {distance:g} cuts the field's diagonal of {diagonal:g} into more than {MOST_STEPS} steps: "
            f"choose a distance near the spacing, {min(field.spacing):g}"
        )
    return distance


def drawn_values(
    field: SampledField, value_range: tuple[float, float], *, needs_neighbours: bool
) -> tuple[NDArray[np.float32], tuple[float, float]]:
    """(values (nz, ny, nx), those of them that become 0 and 1), such that single precision keeps the drawn range.

    Holes have values only where `needs_neighbours`.
    """
    values = field.filled if needs_neighbours else field.values
    if values.dtype == np.float32:
        return values, value_range
    low, high = value_range
    wide = np.longdouble if values.dtype in ("int64", "uint64") else np.float64  # beyond 2**53, too
    scaled = np.empty(values.shape, dtype=np.float32)
    with np.errstate(over="ignore"):
        for plane, samples in zip(scaled, values, strict=True):  # one in double precision at a time
            plane[:] = (samples.astype(wide) - low) / (high - low)
    return scaled, (0.0, 1.0)
