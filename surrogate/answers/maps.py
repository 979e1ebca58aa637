"""Per pixel, the error to expect of a picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, zoom

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from surrogate.answers.doubt import Doubt
from surrogate.evaluation.metrics import WHITE, composite

BLUR = 2.0  # pixels: where predictions differ is more certain than in which pixel


def error_map(
    doubt: Doubt, parameters: Mapping[str, Any], camera: Camera, function: TransferFunction | None = None
) -> NDArray[np.float32]:
    """Expected absolute errors (H, W), mean over channels that go from 0 to 1, by how far predictions differ in a pixel.

    These are the committee of emulators and, where there are some, the Gaussians: beside the field, without one beside other
    embeddings.  They rank pixels; the interval of a picture is what was calibrated.  Raises ValueError as `Surrogate.at` does.
    """
    member, maps = doubt.at(parameters, function), []
    by_field, by_gaussians = member.by_committee, member.by_gaussians
    for opinions in by_gaussians if by_field is None else [by_field]:
        squares = opinions.squares(camera, doubt.background).mean(-1)  # [h, w]
        factors = camera.height / squares.shape[0], camera.width / squares.shape[1]
        maps.append(np.sqrt(zoom(squares, factors, order=1, grid_mode=True, mode="nearest")))
    if by_field is not None and by_gaussians:  # of which the last are the Gaussians and the field
        first, second = (composite(draw(camera), doubt.background or WHITE) for draw in by_gaussians[-1].drawings)
        maps.append(gaussian_filter(np.abs(first - second).mean(-1), BLUR))
    return np.mean(maps, axis=0).astype(np.float32)
