"""Text on pictures: its size, its colour, and lines that fit."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from catalogs.files.images import to_bytes

FONT = "fonts/ttf/DejaVuSans.ttf"  # comes with matplotlib, and has the letters of units and Greek parameters
LEAST_TEXT, MOST_TEXT = 11, 28  # pixels
TEXT_SHARE = 1.0 / 18.0  # of the height of a picture
LIGHT = 0.5  # luminance of a background from which on text is black


def text_size(height: int) -> int:
    """Pixels of text beside pictures of this height."""
    return int(min(MOST_TEXT, max(LEAST_TEXT, round(height * TEXT_SHARE))))


def line_height(size: int) -> int:
    """Pixels from line to line; even, so that films of even pictures stay even."""
    return 2 * (round(0.85 * size))


def pixel(color: Sequence[float]) -> tuple[int, ...]:
    """A colour in [0, 1] as 8 bits."""
    return tuple(to_bytes(np.asarray(color, np.float32)).tolist())


def ink(background: Sequence[float]) -> tuple[int, int, int]:
    """Black or white, whichever is read on the background."""
    luminance = float(np.dot(background, (0.2126, 0.7152, 0.0722)))  # of Rec. 709
    return (0, 0, 0) if luminance > LIGHT else (255, 255, 255)


@functools.cache
def font(size: int) -> Any:
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(f"{matplotlib.get_data_path()}/{FONT}", size)


def wrapped(text: str, size: int, width: int) -> list[str]:
    """The text in lines of at most `width` pixels, broken between words; a longer word has a line of its own."""
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and font(size).getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
