"""Strict validation of PNG files from other programs.

Decoders replace missing pixels, reduce 16 bits to 8, and trust any size.  Before an import every chunk's checksum and the length of
the inflated pixels are checked here, in bounded memory (PNG specification, third edition, sections 5, 9 and 10).

Written here rather than taken from Pillow.  In version 13 its `verify` and `load` accept missing last rows, more bytes than the
header declares, and a file that ends within its last chunk.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from catalogs.files import deflate, durable

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by color type
KINDS = {0: "gray", 2: "RGB", 3: "palette", 4: "gray with alpha", 6: "RGBA"}
LARGEST_SIDE = 16384
TEXT_KIND = b"iTXt"


class PngError(ValueError):
    """A file is not a complete PNG image; the message gives the reason without the file's name."""


@dataclass(frozen=True)
class PngHeader:
    """Size in pixels, bits per channel, colour type and interlacing."""

    width: int
    height: int
    bits: int
    color_type: int
    interlaced: bool

    @property
    def kind(self) -> str:
        """Such as "8-bit RGB"."""
        return f"{'interlaced ' if self.interlaced else ''}{self.bits}-bit {KINDS[self.color_type]}"

    @property
    def has_alpha(self) -> bool:
        return self.color_type in (4, 6)

    @property
    def is_plain_color(self) -> bool:
        """True for 8-bit RGB or RGBA without interlacing."""
        return self.bits == 8 and self.color_type in (2, 6) and not self.interlaced

    @property
    def row_bytes(self) -> int:
        """Bytes of one row before compression, its filter type included."""
        return 1 + (self.width * self.bits * CHANNELS[self.color_type] + 7) // 8


def check_png(path: Path) -> PngHeader:
    """The header of the PNG at `path`, after checking every byte of 8-bit RGB or RGBA.

    Raises PngError for another format, a wrong checksum, a missing end, sides beyond 16384 pixels, and a wrong number of pixels;
    OSError where the file can't be read.
    """
    data = durable.read(path)
    if not data.startswith(SIGNATURE):
        raise PngError("it is not a PNG file")
    chunks = _chunks(data)
    kind, body = next(chunks)
    if kind != b"IHDR" or len(body) != 13:
        raise PngError("it does not begin with a header")
    header = _header(body)
    compressed = [body for kind, body in chunks if kind == b"IDAT"]
    if header.is_plain_color:
        _check_pixels(b"".join(compressed), header)
    return header


def text_body(keyword: str, text: str) -> bytes:
    """The body of an iTXt chunk (section 11.3.3.4): not compressed, in no language.

    Raises ValueError for a keyword that is not 1 to 79 characters of Latin-1, or a text that holds a zero.
    """
    name = keyword.encode("latin-1", errors="replace")
    if not 1 <= len(name) <= 79 or name.decode("latin-1") != keyword or "\0" in keyword + text:
        raise ValueError(f"a text in a PNG has a keyword of 1 to 79 Latin-1 characters and no zeros, got {keyword!r}")
    return name + b"\0\0\0\0\0" + text.encode()


def text_of(data: bytes, keyword: str) -> str | None:
    """The text under `keyword` in an uncompressed iTXt chunk of the PNG file `data`, or None.

    Raises PngError for another format, and for damage before that chunk; the rest is not read.
    """
    if not data.startswith(SIGNATURE):
        raise PngError("it is not a PNG file")
    start = keyword.encode("latin-1") + b"\0\0\0"  # then a language and a translated keyword, each ended by a zero
    for kind, body in _chunks(data):
        content = bytes(body) if kind == TEXT_KIND else b""
        if content.startswith(start):
            return content[len(start) :].split(b"\0", 2)[-1].decode("utf-8", errors="replace")
    return None


def _chunks(data: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Type and body of every chunk up to and with IEND."""
    view, place, kind = memoryview(data), len(SIGNATURE), b""
    while kind != b"IEND":
        if place + 12 > len(data):
            raise PngError(f"it is truncated at byte {len(data)}")
        (length,) = struct.unpack_from(">I", data, place)
        end = place + 12 + length
        if end > len(data):
            raise PngError(f"it is truncated at byte {len(data)}, a chunk should reach to {end}")
        kind = data[place + 4 : place + 8]
        (checksum,) = struct.unpack_from(">I", data, end - 4)
        if deflate.crc32(view[place + 4 : end - 4]) != checksum:
            raise PngError(f"it is damaged: the checksum of the chunk at byte {place} is wrong")
        yield kind, view[place + 8 : end - 4]
        place = end


def _header(body: memoryview) -> PngHeader:
    width, height, bits, color_type, compression, filtering, interlace = struct.unpack(">IIBBBBB", body)
    if color_type not in CHANNELS or bits not in (1, 2, 4, 8, 16) or compression or filtering or interlace > 1:
        raise PngError("its header holds invalid values")
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
        raise PngError(f"it claims {width}x{height} pixels; sides from 1 to {LARGEST_SIDE} are read")
    return PngHeader(width, height, bits, color_type, bool(interlace))


def _check_pixels(compressed: bytes, header: PngHeader) -> None:
    expected = header.row_bytes * header.height
    inflater = deflate.decompressobj()
    try:
        pixels = inflater.decompress(compressed, expected + 1)
    except deflate.DeflateError as error:
        raise PngError(f"it is damaged: {error}") from error
    if len(pixels) != expected or not inflater.eof:
        raise PngError(f"its pixels fill {len(pixels)} bytes, {header.width}x{header.height} need {expected}")
    if max(pixels[:: header.row_bytes]) > 4:
        raise PngError("a row has an invalid filter")
