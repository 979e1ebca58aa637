"""Two pictures side by side with their difference, each under its own words, as one PNG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import to_bytes
from surrogate.explore.exporting.difference import ENTRIES, color_table, difference_of
from surrogate.explore.exporting.lettering import LEAST_TEXT, font, ink, line_height, pixel, text_size, wrapped
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
) -> bytes:
    """A PNG of two pictures of one size, (H, W, 3), and of their absolute difference.

    `words` stand above each of the two, a paragraph each; above the difference stand its numbers, and below it its scale.  Raises
    ValueError for pictures of two sizes.
    """
    from PIL import Image, ImageDraw

    found = difference_of(first, second)
    height, width = first.shape[:2]
    size, column = max(LEAST_TEXT, min(MOST_SIZE, text_size(height))), max(width, LEAST_WIDTH)
    line, gap = line_height(size), max(4, height // 64)
    told = [f"PSNR {found.psnr:.2f} dB between them (higher is better)", f"largest difference {found.maximum:.2g}"]
    columns = [
        [text for paragraph in p for text in wrapped(paragraph, size, column)] for p in (*words, ["difference", *told])
    ]
    above = gap + line * max(map(len, columns)) + gap
    sheet = Image.new("RGB", (gap + 3 * (column + gap), above + height + gap + line), pixel(background))
    write = ImageDraw.Draw(sheet)
    for i, (picture, texts) in enumerate(zip((first, second, found.picture), columns, strict=True)):
        left = gap + i * (column + gap)
        for row, text in enumerate(texts):
            write.text((left, gap + row * line), text, ink(background), font=font(size))
        sheet.paste(Image.fromarray(np.ascontiguousarray(to_bytes(picture))), (left, above))
    top, ends = above + height + gap, ("0", f"{found.high:g}")
    start, stop = (
        left + round(font(size).getlength(f"{ends[0]} ")),
        left + width - round(font(size).getlength(f" {ends[1]}")),
    )
    entries = np.linspace(0, ENTRIES - 1, max(1, stop - start)).astype(int)
    bar = np.broadcast_to(color_table()[entries], (BAR, len(entries), 3))
    sheet.paste(Image.fromarray(np.ascontiguousarray(to_bytes(bar))), (start, top + (line - BAR) // 2))
    for x, text, anchor in ((left, ends[0], "lm"), (left + width, ends[1], "rm")):
        write.text((x, top + line / 2), text, ink(background), font=font(size), anchor=anchor)
    return encode(np.asarray(sheet), "png", record=record)
