"""Images on disk and in memory, and the exact way between the two alpha conventions.

In memory RGBA is premultiplied (Porter & Duff 1984): colour already weighted by alpha.  On disk it is straight, because the
PNG specification (third edition, section 4.2) and its viewers mean that.  For 8 bits the round trip is exact: with alpha a and
premultiplied c <= a, the stored s = round(255 c / a) differs from 255 c / a by at most 1/2, so s a / 255 lies within
a / 510 < 1/2 of c (and at a = 255 they are equal).
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

COMPRESSION = 1  # zlib level: 6 makes files 10 % smaller and takes three times as long
FORMATS = {"png": ".png", "exr": ".exr"}


class ImageError(ValueError):
    """An image file is absent, truncated or not what the catalog says it is."""


def straighten(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Straight 8-bit RGBA [..., 4] of premultiplied; colour above alpha is no valid pixel and is cut to alpha."""
    table = _division_table()
    alpha = rgba[..., 3:]  # [..., 1]
    return np.concatenate([table[alpha, rgba[..., :3]], alpha], axis=-1)


def premultiply(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Premultiplied 8-bit RGBA [..., 4] of straight; inverts `straighten` exactly."""
    alpha = rgba[..., 3:].astype(np.uint16)  # [..., 1]
    colors = (rgba[..., :3] * alpha + 127) // 255
    return np.concatenate([colors.astype(np.uint8), rgba[..., 3:]], axis=-1)


def to_float(rgba: NDArray[Any]) -> NDArray[np.float32]:
    """The same pixels as float32 in [0, 1]."""
    return rgba.astype(np.float32) / np.float32(255.0) if rgba.dtype == np.uint8 else rgba.astype(np.float32)


def to_bytes(rgba: NDArray[Any]) -> NDArray[np.uint8]:
    """The same pixels as uint8, rounded to nearest."""
    return rgba if rgba.dtype == np.uint8 else (np.clip(rgba, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def write_image(path: Path, rgba: NDArray[Any]) -> None:
    """Write premultiplied RGBA [H, W, 4]; `.png` stores 8-bit straight alpha, `.exr` float32 premultiplied.

    Raises ValueError for another shape or dtype, OSError where the disk refuses.
    """
    import OpenImageIO as oiio

    if rgba.ndim != 3 or rgba.shape[2] != 4 or rgba.dtype not in (np.uint8, np.float32):
        raise ValueError(f"an image must be [H, W, 4] of uint8 or float32, got {rgba.shape} of {rgba.dtype}")
    height, width = rgba.shape[:2]
    if path.suffix == ".png":
        pixels: NDArray[Any] = straighten(to_bytes(rgba))
        spec = oiio.ImageSpec(width, height, 4, "uint8")
        spec.attribute("oiio:UnassociatedAlpha", 1)
        spec.attribute("oiio:ColorSpace", "sRGB")
        spec.attribute("png:compressionLevel", COMPRESSION)
    else:
        pixels = to_float(rgba)
        spec = oiio.ImageSpec(width, height, 4, "float")
    output = oiio.ImageOutput.create(str(path))
    written = output is not None and output.open(str(path), spec) and output.write_image(np.ascontiguousarray(pixels))
    closed = output is not None and output.close()
    if not (written and closed):
        raise OSError(f"{path} could not be written: {output.geterror() if output else oiio.geterror()}")


def read_image(path: Path, *, dtype: str = "uint8") -> NDArray[Any]:
    """Premultiplied RGBA [H, W, 4] of an image file, as "uint8" or "float32".

    Grey and RGB files are opaque.  Raises ImageError naming the file when it is absent, truncated or no image.
    """
    import OpenImageIO as oiio

    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise ImageError(f"{path} is no readable image: {oiio.geterror() or 'unknown format'}")
    spec = source.spec()
    pixels = source.read_image("uint8" if path.suffix == ".png" else "float")
    problem = source.geterror()
    source.close()
    if pixels is None or problem:
        raise ImageError(f"{path} is damaged or truncated: {problem or 'no pixels'}")
    rgba = _four_channels(pixels.reshape(spec.height, spec.width, spec.nchannels), path)
    if rgba.dtype == np.uint8:
        rgba = premultiply(rgba)
    return to_float(rgba) if dtype == "float32" else to_bytes(rgba)


def image_shape(path: Path) -> tuple[int, int, int]:
    """Height, width and channels that a file's header states; raises ImageError where it is no image."""
    import OpenImageIO as oiio

    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise ImageError(f"{path} is no readable image: {oiio.geterror() or 'unknown format'}")
    spec = source.spec()
    source.close()
    return spec.height, spec.width, spec.nchannels


def _four_channels(pixels: NDArray[Any], path: Path) -> NDArray[Any]:
    channels = pixels.shape[2]
    if channels not in (1, 2, 3, 4):
        raise ImageError(f"{path} has {channels} channels; 1 to 4 are understood")
    if channels == 4:
        return pixels
    opaque = np.full_like(pixels[..., :1], 255 if pixels.dtype == np.uint8 else 1)
    color = pixels[..., :3] if channels == 3 else np.repeat(pixels[..., :1], 3, axis=2)
    return np.concatenate([color, pixels[..., 1:2] if channels == 2 else opaque], axis=2)


@functools.cache
def _division_table() -> NDArray[np.uint8]:
    alpha = np.arange(256)[:, None]  # [256, 1]
    color = np.minimum(np.arange(256)[None, :], alpha)  # [256, 256]
    table = (2 * 255 * color + alpha) // np.maximum(2 * alpha, 1)
    return table.astype(np.uint8)
