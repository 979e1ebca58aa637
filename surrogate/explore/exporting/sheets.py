"""Sweeps on paper: labelled strips and grids, and captions below the images of a film.

Laid out here rather than by matplotlib.  Its subplots resample images, so that two fifths of their pixels or more change, and take
six times as long for 200 of them.  Its `figimage` needs the same layout in pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.explore.exporting.lettering import LEAST_TEXT, composed, length, line_height, text_size
from surrogate.explore.exporting.pictures import encode
from surrogate.explore.exporting.sweep import Axis, Sweep

LONGEST_ROW = 8  # images of a strip; more are broken into rows
MOST_SIDE = 16384  # pixels of a sheet; what many viewers open, and PNG readers of this project
MOST_PIXELS = 64 * 1024 * 1024


@dataclass(frozen=True)
class _Layout:
    """Pixel positions on a sheet, from its upper left corner."""

    columns: int
    size: tuple[int, int]  # width and height of the sheet
    first: tuple[int, int]  # left and top of the first image
    steps: tuple[int, int]  # to the next column, and to the next row
    side: int  # width of the labels of rows

    def corner(self, index: int) -> tuple[int, int]:
        """Left and top of an image."""
        row, column = divmod(index, self.columns)
        return self.first[0] + column * self.steps[0], self.first[1] + row * self.steps[1]


def strip(
    sweep: Sweep,
    pictures: Iterable[NDArray[Any]],
    *,
    background: Sequence[float],
    record: Mapping[str, Any] | None = None,
) -> bytes:
    """A sweep as one PNG: its images side by side, labelled with their parameter's value; of two parameters as a labelled grid.

    The `pictures`, (H, W, 3) each, come row by row.  The `background` is the straight RGB in [0, 1] of the paper; text is black or
    white.  The PNG keeps the `record`, JSON values as in `surrogate.explore.exporting.pictures.encode`.

    More than eight images of one parameter are broken into rows.  Raises ValueError for a sheet larger than 16384 pixels a side or
    64 million pixels together, as soon as the first image is drawn.  Raises it for more or fewer images than the sweep has, too.
    """
    others = iter(pictures)
    first = next(others, None)
    if first is None:
        raise ValueError(f"a sheet of {len(sweep)} pictures needs as many, got none")
    height, width = first.shape[:2]
    layout, size = _layout(sweep, width, height), text_size(height)
    images = zip(map(layout.corner, range(len(sweep))), chain([first], others), strict=True)
    texts: list[tuple[tuple[float, float], str, str]] = []
    for index, text in enumerate(sweep.columns.labels):
        left, top = layout.corner(index)
        texts.append(((left + width / 2, top - line_height(size) / 2), text, "mm"))
    for row, text in enumerate(sweep.rows.labels if sweep.rows else ()):
        texts.append(((layout.side, layout.corner(row * layout.columns)[1] + height / 2), text, "rm"))
    return encode(composed(layout.size, background, images, texts, size), "png", record=record)


def captioned(
    pictures: Iterable[NDArray[Any]], sweep: Sweep, *, background: Sequence[float]
) -> Iterator[NDArray[np.uint8]]:
    """The images of a sweep over one parameter with its values written below: (H + h, W, 3) each."""
    for text, picture in zip(sweep.columns.labels, pictures, strict=True):
        height, width = picture.shape[:2]
        size = text_size(height)
        band = line_height(size)
        while size > LEAST_TEXT and length(text, size) > width:
            size -= 1
        caption = (width / 2, height + band / 2), text, "mm"
        yield composed((width, height + band), background, [((0, 0), picture)], [caption], size)


def _layout(sweep: Sweep, width: int, height: int) -> _Layout:
    """For images of this size; raises ValueError for a sheet that is too large."""
    size, gap = text_size(height), max(2, height // 64)
    line, cell = line_height(size), max(width, _widest(sweep.columns, size) + size)
    side = 0 if sweep.rows is None else _widest(sweep.rows, size) + size // 2
    columns = sweep.columns.count
    if sweep.rows is None and columns > LONGEST_ROW:  # broken into rows: a little wider than high
        columns = math.ceil(columns / max(2, round(math.sqrt(columns * width / height / 1.6))))
    rows = math.ceil(len(sweep) / columns)
    above = line if sweep.rows is None else 0  # every row of a strip has its titles, of a grid only the first
    across, down = cell + gap, above + gap + height
    sheet = (side + gap + columns * across, line - above + gap + rows * down)
    if max(sheet) > MOST_SIDE or math.prod(sheet) > MOST_PIXELS:
        raise ValueError(
            f"a sheet of {len(sweep)} pictures of {width}x{height} would have {sheet[0]}x{sheet[1]} pixels, more than "
            f"{MOST_SIDE} a side or {MOST_PIXELS:,} together: choose fewer steps or smaller pictures"
        )
    return _Layout(columns, sheet, (side + gap + (cell - width) // 2, line + gap), (across, down), side)


def _widest(axis: Axis, size: int) -> int:
    return math.ceil(max(length(text, size) for text in axis.labels))
