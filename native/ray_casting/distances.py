"""The distance of samples along rays that a function needs: as long as shorter ones change a small image little."""

from __future__ import annotations

import numpy as np

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native.ray_casting.fields import SampledField
from native.ray_casting.volume import VolumeCaster

DECIBELS = 50.0  # PSNR of an image against one of half the distance
SHORTEST = 1.0 / 16.0  # of the smallest spacing
SIDE = 48  # pixels of the images that are compared


def fitting_distance(
    field: SampledField, appearance: VolumeRendering, camera: Camera, *, decibels: float = DECIBELS
) -> float:
    """The longest of 1, 1/2, 1/4, ... of the smallest spacing whose image is that good, world units.

    `camera` sees the whole field; only its direction and distance matter.  A narrow peak of the transfer function takes shorter
    distances than a wide one.

    Examples
    --------
    >>> from blobs import APPEARANCE, CAMERA, PLACE, simulate
    >>> from native.ray_casting import SampledField, fitting_distance
    >>> distance = fitting_distance(SampledField(simulate(0.8, 0.3), **PLACE), APPEARANCE, CAMERA, decibels=45.0)
    >>> f"{distance / PLACE['spacing'][0]:g} spacings"
    '1 spacings'
    """
    small = camera.resized(SIDE, SIDE)
    distance = min(field.spacing)
    image = VolumeCaster.of(field, appearance, sample_distance=distance).draw(small)
    while distance > SHORTEST * min(field.spacing):
        finer = VolumeCaster.of(field, appearance, sample_distance=distance / 2.0).draw(small)
        error = float(np.mean((image.astype(np.float64) - finer) ** 2))
        if error <= 10.0 ** (-decibels / 10.0):
            break
        distance, image = distance / 2.0, finer
    return distance
