"""Pictures of blocks put together into one of the whole."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class PictureLayer:
    """One piece's part of an image.

    Attributes
    ----------
    rows, columns : the part of the picture that it covers.
    image : premultiplied RGBA [h, w, 4] there, uint8, or float32 in [0, 1].
    depths : [h, w] float32, growing with the distance, of surfaces; None of a volume.
    """

    rows: slice
    columns: slice
    image: NDArray[np.uint8] | NDArray[np.float32]
    depths: NDArray[np.float32] | None = None


def packed(layer: PictureLayer) -> NDArray[np.uint8]:
    """The bytes of a layer: which of its pixels are covered at all, and these alone."""
    covered = layer.image[..., 3] > 0  # [h, w]
    parts = [np.packbits(covered), layer.image[covered], *([] if layer.depths is None else [layer.depths[covered]])]
    return np.concatenate([part.reshape(-1).view(np.uint8) for part in parts])


def unpacked(
    data: NDArray[np.uint8], rows: slice, columns: slice, dtype: str, *, surfaces: bool
) -> tuple[PictureLayer, NDArray[np.uint8]]:
    """The layer at the beginning of `data`, pictures of a `dtype`, and what follows it; `surfaces` have depths."""
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    count = shape[0] * shape[1]
    bits, data = np.split(data, [(count + 7) // 8])
    covered = np.unpackbits(bits, count=count).astype(bool).reshape(shape)
    image = np.zeros((*shape, 4), dtype=dtype)
    pixels, data = np.split(data, [4 * int(covered.sum()) * image.itemsize])
    image[covered] = pixels.copy().view(dtype).reshape(-1, 4)
    if not surfaces:
        return PictureLayer(rows, columns, image), data
    depths = np.ones(shape, dtype=np.float32)
    data_of_depths, data = np.split(data, [4 * int(covered.sum())])
    depths[covered] = data_of_depths.copy().view(np.float32)
    return PictureLayer(rows, columns, image, depths), data


def over(layers: Iterable[PictureLayer], height: int, width: int) -> NDArray[np.float32]:
    """Volumes one behind the other, front to back: premultiplied RGBA [height, width, 4] float32 (Porter & Duff 1984, "over")."""
    image = np.zeros((height, width, 4), dtype=np.float32)
    for layer in layers:
        here = image[layer.rows, layer.columns]
        here += (np.float32(1.0) - here[..., 3:]) * layer.image
    return np.minimum(image, np.float32(1.0), out=image)


def nearest(
    layers: Iterable[PictureLayer], height: int, width: int, dtype: str
) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Opaque surfaces: of each pixel the layer that lies nearest; [height, width, 4] of a `dtype`, "uint8" or "float32"."""
    image = np.zeros((height, width, 4), dtype=dtype)
    depths = np.ones((height, width), dtype=np.float32)
    for layer in layers:
        here, before = depths[layer.rows, layer.columns], image[layer.rows, layer.columns]
        assert layer.depths is not None
        nearer = layer.depths < here
        here[nearer], before[nearer] = layer.depths[nearer], layer.image[nearer]
    return image
