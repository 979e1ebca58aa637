"""Reading and writing of images, and exact conversion between the two alpha conventions.

In memory RGBA is premultiplied (Porter & Duff 1984): colour is weighted by alpha.  On disk it is straight, as the PNG
specification (third edition, section 4.2) demands.  For 8 bits the round trip is exact.  With alpha a and premultiplied c <= a,
s = round(255 c / a) is stored.  It differs from 255 c / a by at most 1/2, so s a / 255 lies within a / 510 < 1/2 of c.
"""

from __future__ import annotations

import functools
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files import deflate, durable
from catalogs.files.digests import digest_of, digest_of_file
from catalogs.files.png import SIGNATURE, TEXT_KIND, text_body

FORMATS = {"png": ".png", "exr": ".exr"}
MOST_CHANNELS = 4
VALUES_AT_ONCE = 32768
ROUNDING, HIGHEST = np.float32(0.501), np.float32(255.0)  # before fractions are cut off
COLOR_TYPES = {3: 2, 4: 6}  # of a PNG, by channels


class ImageError(ValueError):
    """An image file is absent, truncated, or contradicts its catalog."""


def straighten(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Straight 8-bit RGBA [..., 4] of premultiplied; colour above alpha, which is invalid, is reduced to alpha."""
    return _scaled(rgba, _straightening(), invalid=True)


def premultiply(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Premultiplied 8-bit RGBA [..., 4] of straight; inverts `straighten` exactly."""
    return _scaled(rgba, _premultiplying(), invalid=False)


def to_float(rgba: NDArray[Any]) -> NDArray[np.float32]:
    """The same pixels as float32 in [0, 1]."""
    return rgba.astype(np.float32) / np.float32(255.0) if rgba.dtype == np.uint8 else rgba.astype(np.float32)


def to_bytes(rgba: NDArray[Any]) -> NDArray[np.uint8]:
    """The same pixels as uint8, rounded to nearest."""
    if rgba.dtype == np.uint8 or 0 in rgba.shape:
        return rgba.astype(np.uint8, copy=False)
    pixels = np.empty(rgba.shape, np.uint8)
    rows = max(1, VALUES_AT_ONCE // rgba[0].size)
    for first in range(0, len(rgba), rows):  # whole images would leave the cache three times
        scaled = np.clip(rgba[first : first + rows], 0.0, 1.0)
        scaled *= 255.0
        scaled += 0.5
        pixels[first : first + rows] = scaled
    return pixels


def write_image(path: Path, rgba: NDArray[Any]) -> str:
    """Write premultiplied RGBA [H, W, 4]; `.png` stores 8-bit straight alpha, `.exr` float32 premultiplied.

    Returns the file's digest (`catalogs.files.digests`).

    Raises ValueError for another shape or dtype and for floats that are not finite; OSError where the disk refuses.
    """
    if rgba.ndim != 3 or rgba.shape[2] != 4 or 0 in rgba.shape or rgba.dtype not in (np.uint8, np.float32):
        raise ValueError(f"an image must be [H, W, 4] of uint8 or float32, got {rgba.shape} of {rgba.dtype}")
    if rgba.dtype == np.float32 and not np.isfinite(rgba).all():
        raise ValueError("an image must be finite: it holds NaN or infinite pixels")
    if path.suffix == ".png":
        data = encode_png(straighten(to_bytes(rgba)))
        durable.write(path, data)
        return digest_of(data)
    write_exr(path, to_float(rgba))
    return digest_of_file(path)


def encode_png(pixels: NDArray[np.uint8], texts: Mapping[str, str] | None = None) -> bytes:
    """RGB [H, W, 3] or straight RGBA [H, W, 4] as a PNG file (PNG specification, third edition, sections 5, 9 and 10).

    `texts` are stored by keyword in chunks of type iTXt (section 11.3.3.4); `catalogs.files.png.text_of` reads them.

    Written here rather than taken from a library: every row has filter 1 ("Sub") and is deflated by run lengths, which no library
    offers.  Rendered images become as small as by a full search at zlib's level 1, six times faster, and a full disk raises.
    The file has the same bytes with and without zlib-ng (`catalogs.files.deflate`).
    """
    height, width, channels = pixels.shape
    rows = pixels.reshape(height, channels * width)
    filtered = np.empty((height, 1 + channels * width), dtype=np.uint8)
    filtered[:, 0] = 1
    filtered[:, 1 : 1 + channels] = rows[:, :channels]
    np.subtract(rows[:, channels:], rows[:, :-channels], out=filtered[:, 1 + channels :])  # modulo 256
    stream = deflate.compressobj(1, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_RLE)
    header = struct.pack(">IIBBBBB", width, height, 8, COLOR_TYPES[channels], 0, 0, 0)
    chunks = (
        (b"IHDR", header),
        (b"sRGB", b"\0"),
        *((TEXT_KIND, text_body(keyword, text)) for keyword, text in (texts or {}).items()),
        (b"IDAT", stream.compress(filtered) + stream.flush()),
        (b"IEND", b""),
    )
    return SIGNATURE + b"".join(_chunk(kind, body) for kind, body in chunks)


def read_image(path: Path, *, dtype: str = "uint8") -> NDArray[Any]:
    """Premultiplied RGBA [H, W, 4] of an image file, as "uint8" or "float32".

    Gray and RGB files are opaque.  Raises ImageError naming a file that is absent, truncated or not an image.
    """
    return in_memory(_four_channels(read_stored(path), path), dtype)


def in_memory(image: NDArray[Any], dtype: str = "uint8") -> NDArray[Any]:
    """Premultiplied RGBA [H, W, 4], "uint8" or "float32", of stored RGBA, which is straight where it is uint8."""
    rgba = premultiply(image) if image.dtype == np.uint8 else image
    return to_float(rgba) if dtype == "float32" else to_bytes(rgba)


def read_stored(path: Path) -> NDArray[Any]:
    """The channels [H, W, C] as stored in an image file: uint8 for PNG (alpha straight), else float32.

    Raises ImageError naming a file that is absent, truncated or not an image.
    """
    with _opened(path) as source:
        spec = source.spec()
        pixels = source.read_image("uint8" if source.format_name() == "png" else "float")
        problem = source.geterror()
    if pixels is None or problem:
        raise ImageError(f"{path} is damaged or truncated: {problem or 'no pixels'}")
    return pixels.reshape(spec.height, spec.width, spec.nchannels)


def write_exr(path: Path, pixels: NDArray[np.float32], texts: Mapping[str, str] | None = None) -> None:
    """Write RGB [H, W, 3] or premultiplied RGBA [H, W, 4] as float32, with `texts` as string attributes.

    Equal pixels and texts give equal bytes.  Raises OSError where the disk refuses.
    """
    import OpenImageIO as oiio

    height, width, channels = pixels.shape
    output = oiio.ImageOutput.create(str(path))
    if output is None:
        raise OSError(f"{path} could not be written: {oiio.geterror()}")
    spec = oiio.ImageSpec(width, height, channels, "float")
    spec.attribute("DateTime", "")  # else the time of writing is stored
    for name, text in (texts or {}).items():
        spec.attribute(name, text)
    opened = output.open(str(path), spec)
    written = opened and output.write_image(np.ascontiguousarray(pixels))
    if not (output.close() and written):
        raise OSError(f"{path} could not be written: {output.geterror()}")


def exr_text(path: Path, name: str) -> str | None:
    """The string attribute `name` of an EXR file, or None; raises ImageError for other files."""
    with _opened(path) as source:
        value = source.spec().getattribute(name)
    return value if isinstance(value, str) else None


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """An image file opened by OpenImageIO, alpha as stored."""
    import OpenImageIO as oiio

    if not path.is_file():
        kind = durable.special(path)
        raise ImageError(f"{path} is {kind}, not an image" if kind else f"{path} is missing")
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise ImageError(f"{path} is not a readable image: {oiio.geterror() or 'unknown format'}")
    try:
        yield source
    finally:
        source.close()


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", deflate.crc32(kind + body))


def _four_channels(pixels: NDArray[Any], path: Path) -> NDArray[Any]:
    channels = pixels.shape[2]
    if channels > MOST_CHANNELS:
        raise ImageError(f"{path} has {channels} channels; images have 1 to 4")
    if channels == 4:
        return pixels
    opaque = np.full_like(pixels[..., :1], 255 if pixels.dtype == np.uint8 else 1)
    color = pixels[..., :3] if channels == 3 else np.repeat(pixels[..., :1], 3, axis=2)
    return np.concatenate([color, pixels[..., 1:2] if channels == 2 else opaque], axis=2)


def _scaled(rgba: NDArray[np.uint8], factors: NDArray[np.float32], *, invalid: bool) -> NDArray[np.uint8]:
    """Pixels [..., 4] times the `factors` of their alpha, rounded; `invalid` products, above 255, are reduced to it.

    Exact: float32 misses products by less than 1/10,000; those that are to be rounded down lie at least 1/510 below a half.
    """
    pixels = rgba.reshape(-1, 4)  # [N, 4]
    scaled = np.empty_like(pixels)
    for first in range(0, len(pixels), VALUES_AT_ONCE // 4):
        part = pixels[first : first + VALUES_AT_ONCE // 4]
        products = factors.take(part[:, 3], axis=0)  # [n, 4]
        products *= part
        if invalid:
            np.minimum(products, HIGHEST, out=products)
        products += ROUNDING
        scaled[first : first + VALUES_AT_ONCE // 4] = products
    return scaled.reshape(rgba.shape)


@functools.cache
def _straightening() -> NDArray[np.float32]:
    """Factors [256, 4] of straight colour and of alpha, by alpha."""
    factors = np.ones((256, 4), np.float32)
    factors[0, :3] = 0.0
    factors[1:, :3] = 255.0 / np.arange(1, 256)[:, None]
    return factors


@functools.cache
def _premultiplying() -> NDArray[np.float32]:
    """Factors [256, 4] of premultiplied colour and of alpha, by alpha."""
    factors = np.ones((256, 4), np.float32)
    factors[:, :3] = np.arange(256)[:, None] / 255.0
    return factors
