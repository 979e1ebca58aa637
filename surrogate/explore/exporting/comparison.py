"""Two images side by side with their difference, each under its own text, as one PNG."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.explore.exporting.difference import ENTRIES, color_table, difference_of
from surrogate.explore.exporting.lettering import LEAST_TEXT, composed, length, line_height, text_size, wrapped
from surrogate.explore.exporting.pictures import encode

LEAST_WIDTH = 200  # pixels of a column, so that words find room
MOST_SIZE = 16  # pixels of text
BAR = 12  # pixels, of the scale below the difference


def comparison(
    first: NDArray[np.float32],
    second: NDArray[np.float32],
    words: Sequence[Sequence[str]],
    *,
    background: Sequence[float],
    record: Mapping[str, Any] | None = None,
    over: Callable[[NDArray[np.float32], int], NDArray[np.float32]] = lambda image, number: image,
) -> bytes:
    """A PNG of two images of one size, (H, W, 3), and of their absolute difference.

    `words` stand above each of the two, a paragraph each; the difference has its numbers above and its scale below.  Raises
    ValueError for images of two sizes.  `over` draws over both of them, number 0 and 1.
    """
    difference = difference_of(first, second)
    height, width = first.shape[:2]
    size, column = max(LEAST_TEXT, min(MOST_SIZE, text_size(height))), max(width, LEAST_WIDTH)
    line, gap = line_height(size), max(4, height // 64)
    numbers = [
        f"PSNR {difference.psnr:.2f} dB between them (higher is better)",
        f"largest difference {difference.maximum:.2g}",
    ]
    columns = [
        [text for part in parts for text in wrapped(part, size, column)] for parts in (*words, ["difference", *numbers])
    ]
    above = gap + line * max(map(len, columns)) + gap
    lefts = [gap + i * (column + gap) for i in range(3)]
    texts = [
        ((left, gap + row * line), text, "la")
        for left, lines in zip(lefts, columns, strict=True)
        for row, text in enumerate(lines)
    ]
    left, top, ends = lefts[-1], above + height + gap, ("0", f"{difference.high:g}")
    start, stop = left + round(length(f"{ends[0]} ", size)), left + width - round(length(f" {ends[1]}", size))
    entries = np.linspace(0, ENTRIES - 1, max(1, stop - start)).astype(int)
    bar = np.broadcast_to(color_table()[entries], (BAR, len(entries), 3))
    images = [
        ((x, above), image)
        for x, image in zip(lefts, (over(first, 0), over(second, 1), difference.picture), strict=True)
    ]
    images.append(((start, top + (line - BAR) // 2), bar))
    texts += [((left, top + line / 2), ends[0], "lm"), ((left + width, top + line / 2), ends[1], "rm")]
    sheet = composed((gap + 3 * (column + gap), top + line), background, images, texts, size)
    return encode(sheet, "png", record=record)
