"""Pictures of a surrogate in batches, and cheap ones that resemble them: where many are drawn to find a few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering, field_of
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from native.ray_casting import SurfaceCaster, VolumeCaster
from surrogate.answers.committee import caster_of, thinned
from surrogate.emulation import FieldEmulator
from surrogate.model import FieldModel, Surrogate

AT_ONCE = 32  # fields in memory together

Array = NDArray[np.float64]
Views = Sequence[Sequence[Camera]]  # [B][T], all of one size


class Draws(Protocol):
    """That draws pictures (B, T, H, W, 4), premultiplied, at normalized parameters (B, P), of each by T cameras of its own."""

    def pictures(self, points: Array, views: Views) -> NDArray[np.float32]: ...


@dataclass(frozen=True, eq=False)
class Drawn:
    """A surrogate's own pictures."""

    surrogate: Surrogate

    __repr__ = one_line

    def pictures(self, points: Array, views: Views) -> NDArray[np.float32]:
        """See `Draws`."""
        rows = np.repeat(self.surrogate.space.denormalize(points), len(views[0]), axis=0)
        pictures = self.surrogate.render(rows, [camera for own in views for camera in own], outside="allow")
        return pictures.reshape(len(points), len(views[0]), *pictures.shape[1:])


@dataclass(frozen=True, eq=False)
class Draft:
    """Those of an emulated field in the base appearance, on a coarse lattice and with long steps along rays."""

    emulator: FieldEmulator
    appearance: VolumeRendering | Isosurface
    sample_distance: float | None

    __repr__ = one_line

    @classmethod
    def of(cls, field: FieldModel) -> Draft:
        """The draft of a model."""
        appearance = field.appearances[0]
        assert isinstance(appearance, VolumeRendering | Isosurface)
        distance = field.sample_distances.get(appearance.name)
        emulator = thinned(field.emulators[field_of(appearance)])
        return cls(emulator, appearance, distance)

    def pictures(self, points: Array, views: Views) -> NDArray[np.float32]:
        """See `Draws`."""
        first = views[0][0]
        pictures = np.empty((len(points), len(views[0]), first.height, first.width, 4), dtype=np.float32)
        for start in range(0, len(points), AT_ONCE):
            some = points[start : start + AT_ONCE]
            for number, caster in enumerate(self._casters(some), start):
                for view, camera in enumerate(views[number]):
                    pictures[number, view] = caster.draw(camera, threads=1)
        return pictures

    def _casters(self, points: Array) -> list[VolumeCaster | SurfaceCaster]:
        places, inverse = np.unique(points, axis=0, return_inverse=True)
        casters = [self._caster(v, p) for v, p in zip(values_at(self.emulator, places), places, strict=True)]
        return [casters[i] for i in inverse.ravel()]

    def _caster(self, values: NDArray[np.float32], point: Array) -> VolumeCaster | SurfaceCaster:
        return caster_of(self.emulator, values, self.emulator.holes(point), self.appearance, self.sample_distance)


def values_at(emulator: FieldEmulator, points: Array) -> NDArray[np.float32]:
    """The fields (B, Z, Y, X) that an emulator expects at normalized parameters (B, P)."""
    scaled = emulator.mean + emulator.processes.means(points).astype(np.float32) @ emulator.modes  # [B, V]
    values = scaled if emulator.scale is None else emulator.scale.values(scaled).astype(np.float32)
    return values.reshape(len(points), *emulator.shape)
