"""Per pixel, the error to expect of a picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, zoom

from catalogs.files.images import encode_png
from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from surrogate.answers.doubt import Doubt

BLUR = 2.0  # pixels: where predictions differ is more certain than in which pixel
WORST = 0.2  # error, of which the map's colour is the last
STOPS, COLORS = (0.0, 0.3, 0.7, 1.0), ((255, 253, 179, 0), (255, 174, 0, 0), (255, 97, 38, 0))


def error_map(
    doubt: Doubt, parameters: Mapping[str, Any], camera: Camera, function: TransferFunction | None = None
) -> NDArray[np.float32]:
    """Expected absolute errors (H, W), mean over channels that go from 0 to 1, by how far predictions differ in a pixel.

    These are the committee of emulators and, where there are some, the Gaussians.  They rank pixels; the interval of a picture is
    what was calibrated.  Raises ValueError as `Surrogate.at` does.
    """
    squares = doubt.opinions(parameters, function).squares(camera, doubt.background).mean(-1)  # [h, w]
    factors = camera.height / squares.shape[0], camera.width / squares.shape[1]
    errors = np.sqrt(zoom(squares, factors, order=1, grid_mode=True, mode="nearest"))
    if len(doubt.surrogate.gaussians):
        first, second = doubt.pair(parameters, camera, function)
        errors = 0.5 * (errors + gaussian_filter(np.abs(first - second).mean(-1), BLUR))
    return errors.astype(np.float32)


def map_png(errors: NDArray[np.floating]) -> bytes:
    """A map (H, W) as a PNG: white without error, through orange to black at `WORST`."""
    places = np.clip(errors / WORST, 0.0, 1.0)
    channels = [np.interp(places, STOPS, values) for values in COLORS]
    return encode_png(np.stack(channels, -1).round().astype(np.uint8))
