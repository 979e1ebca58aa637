"""Sweeps on paper: labelled strips and grids, and captions below the pictures of a film."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.images import to_bytes
from surrogate.explore.exporting.pictures import encode
from surrogate.explore.exporting.sweep import Sweep

FONT = "fonts/ttf/DejaVuSans.ttf"  # comes with matplotlib, and has the letters of units and Greek parameters
LEAST_TEXT, MOST_TEXT = 11, 28  # pixels
TEXT_SHARE = 1.0 / 18.0  # of the height of a picture
LONGEST_ROW = 8  # pictures of a strip; more are broken into rows
MOST_SIDE = 16384  # pixels of a sheet; what many viewers open, and PNG readers of this project
MOST_PIXELS = 64 * 1024 * 1024
LIGHT = 0.5  # luminance of a background from which on text is black


@dataclass(frozen=True)
class _Layout:
    """Where things stand on a sheet, in pixels; `titles` above every row of a strip, or above the first of a grid."""

    columns: int
    rows: int
    picture: tuple[int, int]  # width, height
    cell: int  # width
    left: int  # width of the labels of rows
    line: int  # height of a label
    gap: int
    every_row: bool

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sheet."""
        titles = self.line * (self.rows if self.every_row else 1)
        width = self.left + self.gap + self.columns * (self.cell + self.gap)
        return width, titles + self.gap + self.rows * (self.picture[1] + self.gap)

    def place(self, index: int) -> tuple[int, int]:
        """Left and top of a picture."""
        row, column = divmod(index, self.columns)
        left = self.left + self.gap + column * (self.cell + self.gap) + (self.cell - self.picture[0]) // 2
        titles = self.line * (row + 1 if self.every_row else 1)
        return left, titles + self.gap + row * (self.picture[1] + self.gap)


def strip(
    sweep: Sweep,
    pictures: Iterable[NDArray[Any]],
    *,
    background: Sequence[float],
    record: Mapping[str, Any] | None = None,
) -> bytes:
    """A sweep as one PNG: its pictures side by side, each with its parameter's value above; of two parameters as a labelled grid.

    Parameters
    ----------
    sweep : what is shown.
    pictures : (H, W, 3) each, row by row, as `surrogate.explore.exporting.sweep.pictures` draws them.
    background : straight RGB in [0, 1] of the paper; text is black or white.
    record : JSON values that the PNG keeps, as in `surrogate.explore.exporting.pictures.encode`.

    More than eight pictures of one parameter are broken into rows.  Raises ValueError for a sheet larger than 16384 pixels a side
    or 64 million pixels together, as soon as the first picture is drawn, and for more or fewer pictures than the sweep has.
    """
    from PIL import Image, ImageDraw

    labels = _labels(sweep)
    iterator = iter(pictures)
    first = next(iterator, None)
    if first is None:
        raise ValueError(f"a sheet of {len(sweep)} pictures needs as many, got none")
    layout = _layout(sweep, labels, first.shape[1], first.shape[0])
    sheet = Image.new("RGB", layout.size, _pixel(background))
    for index, picture in zip(range(len(sweep)), _chained(first, iterator), strict=True):
        sheet.paste(Image.fromarray(np.ascontiguousarray(to_bytes(picture))), layout.place(index))
    _write_labels(ImageDraw.Draw(sheet), layout, labels, _ink(background))
    return encode(np.asarray(sheet), "png", record=record)


def captioned(
    pictures: Iterable[NDArray[Any]],
    sweep: Sweep,
    *,
    background: Sequence[float],
) -> Iterator[NDArray[np.uint8]]:
    """The same pictures with their parameters' values written below: (H + h, W, 3) each."""
    from PIL import Image, ImageDraw

    columns, rows = _labels(sweep)
    texts = [", ".join(filter(None, (row, column))) for row in rows or [""] for column in columns]
    for text, picture in zip(texts, pictures, strict=True):
        height, width = picture.shape[:2]
        size = _text_size(height)
        while size > LEAST_TEXT and _font(size).getlength(text) > width:
            size -= 1
        band = _line(_text_size(height))
        framed = Image.new("RGB", (width, height + band), _pixel(background))
        framed.paste(Image.fromarray(np.ascontiguousarray(to_bytes(picture))), (0, 0))
        centre = (width / 2, height + band / 2)
        ImageDraw.Draw(framed).text(centre, text, _ink(background), font=_font(size), anchor="mm")
        yield np.asarray(framed)


def _labels(sweep: Sweep) -> tuple[list[str], list[str]]:
    """Of the columns, or of all pictures of a strip; and of the rows of a grid, none for a strip."""
    return sweep.columns.labels, [] if sweep.rows is None else sweep.rows.labels


def _layout(sweep: Sweep, labels: tuple[list[str], list[str]], width: int, height: int) -> _Layout:
    titles, sides = labels
    size = _text_size(height)
    columns = len(titles)
    if not sides and columns > LONGEST_ROW:
        rows = max(2, round(math.sqrt(columns * width / height / 1.6)))  # of a sheet that is a little wider than high
        columns = math.ceil(columns / rows)
    layout = _Layout(
        columns=columns,
        rows=len(sides) or math.ceil(len(titles) / columns),
        picture=(width, height),
        cell=max(width, _widest(titles, size) + size),
        left=_widest(sides, size) + size // 2 if sides else 0,
        line=_line(size),
        gap=max(2, height // 64),
        every_row=not sides,
    )
    if max(layout.size) > MOST_SIDE or layout.size[0] * layout.size[1] > MOST_PIXELS:
        raise ValueError(
            f"a sheet of {len(sweep)} pictures of {width}x{height} would have {layout.size[0]}x{layout.size[1]} pixels, more than "
            f"{MOST_SIDE} a side or {MOST_PIXELS:,} together: choose fewer steps or smaller pictures"
        )
    return layout


def _write_labels(draw: Any, layout: _Layout, labels: tuple[list[str], list[str]], ink: tuple[int, int, int]) -> None:
    titles, sides = labels
    font = _font(_text_size(layout.picture[1]))
    for index, text in enumerate(titles):
        left, top = layout.place(index)
        draw.text((left + layout.picture[0] / 2, top - layout.line / 2), text, ink, font=font, anchor="mm")
    for row, text in enumerate(sides):
        middle = layout.place(row * layout.columns)[1] + layout.picture[1] / 2
        draw.text((layout.left, middle), text, ink, font=font, anchor="rm")


def _chained(first: NDArray[Any], others: Iterator[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    yield first
    yield from others


def _text_size(height: int) -> int:
    return int(min(MOST_TEXT, max(LEAST_TEXT, round(height * TEXT_SHARE))))


def _line(size: int) -> int:
    return 2 * (round(0.85 * size))  # even, so that films of even pictures stay even


def _widest(texts: Sequence[str], size: int) -> int:
    return math.ceil(max((_font(size).getlength(text) for text in texts), default=0.0))


def _pixel(color: Sequence[float]) -> tuple[int, int, int]:
    red, green, blue = to_bytes(np.asarray(color, np.float32)).tolist()
    return red, green, blue


def _ink(background: Sequence[float]) -> tuple[int, int, int]:
    luminance = float(np.dot(background, (0.2126, 0.7152, 0.0722)))  # of Rec. 709
    return (0, 0, 0) if luminance > LIGHT else (255, 255, 255)


@functools.cache
def _font(size: int) -> Any:
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / FONT), size)
