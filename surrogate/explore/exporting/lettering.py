"""Images and text composed on one sheet: pixels of images stay exact, text is set in DejaVu Sans."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import to_bytes

FONT = "fonts/ttf/DejaVuSans.ttf"  # comes with matplotlib, and has the letters of units and Greek parameters
LEAST_TEXT, MOST_TEXT = 11, 28  # pixels
TEXT_SHARE = 1.0 / 18.0  # of the height of an image
LIGHT = 0.5  # luminance of a background from which on text is black


def composed(
    size: tuple[int, int],
    background: Sequence[float],
    images: Iterable[tuple[tuple[int, int], NDArray[Any]]],
    texts: Iterable[tuple[tuple[float, float], str, str]],
    text_size: int,
) -> NDArray[np.uint8]:
    """A sheet (H, W, 3) of `size` (width, height) pixels on the straight RGB `background`.

    `images` (h, w, 3), float in [0, 1] or uint8, come with their left and top; `texts` with a point (x, y) and their anchor there,
    as Pillow has it.  Text is black or white.
    """
    from PIL import Image, ImageDraw

    sheet = np.full((size[1], size[0], 3), to_bytes(np.asarray(background, np.float32)))
    for (left, top), image in images:
        sheet[top : top + image.shape[0], left : left + image.shape[1]] = to_bytes(image)
    canvas = Image.fromarray(sheet)
    luminance = float(np.dot(background, (0.2126, 0.7152, 0.0722)))  # of Rec. 709
    ink = (0, 0, 0) if luminance > LIGHT else (255, 255, 255)
    for point, text, anchor in texts:
        ImageDraw.Draw(canvas).text(point, text, ink, font=_font(text_size), anchor=anchor)
    return np.asarray(canvas)


def text_size(height: int) -> int:
    """Pixels of text beside images of this height."""
    return int(min(MOST_TEXT, max(LEAST_TEXT, round(height * TEXT_SHARE))))


def line_height(size: int) -> int:
    """Pixels from line to line; even, so that films of even images stay even."""
    return 2 * (round(0.85 * size))


def length(text: str, size: int) -> float:
    """Pixels that a line of text takes."""
    return float(_font(size).getlength(text))


def wrapped(text: str, size: int, width: int) -> list[str]:
    """The text in lines of at most `width` pixels, broken between words; a longer word has a line of its own."""
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and length(longer, size) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


@functools.cache
def _font(size: int) -> Any:
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(f"{matplotlib.get_data_path()}/{FONT}", size)
