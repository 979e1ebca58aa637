"""Cards for notebooks: facts and small pictures as HTML that stands alone.

Colours are inherited and lines are translucent, so that cards are readable on the light and the dark theme of Jupyter alike.  All
style is inline, because notebooks that are not trusted lose style sheets.  Whatever comes from files is escaped.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import encode_png, to_bytes, to_float

WHITE = (1.0, 1.0, 1.0)
TILE_WIDTH = 104  # pixels of a picture on the page; its file may have fewer
MOST_BYTES = 40_000  # of all pictures of a card, 53 kB in base64
LONGEST = 300  # characters of one fact

FRAME = "font:13px/1.5 system-ui,sans-serif;max-width:60em;overflow-wrap:anywhere"
PLAIN = "background:transparent;border:0;padding:1px 12px 1px 0;text-align:left;vertical-align:top;white-space:normal"
LABEL = f"{PLAIN};opacity:.7;font-weight:normal;white-space:nowrap"
TILE = "display:block;box-sizing:border-box;width:100%;height:auto;margin:0;border-radius:4px;border:1px solid rgba(128,128,128,.4)"
CAPTION = "opacity:.7;font-size:11px;line-height:1.3"
TABLE = "border-collapse:collapse;border:0;margin:4px 0;font:inherit;color:inherit"


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture on a card: straight RGB [H, W, 3] uint8, the caption below it and its tooltip."""

    rgb: NDArray[np.uint8] = field(repr=False)
    caption: str = ""
    title: str = ""


def card(
    heading: str,
    rows: Sequence[tuple[str, str]],
    pictures: Sequence[Picture] = (),
    notes: Sequence[str] = (),
    *,
    width: int = TILE_WIDTH,
) -> str:
    """A card of a heading, a table of (what, in words), a row of pictures `width` pixels wide, and notes below."""
    cells = "".join(
        f'<tr style="background:transparent"><th style="{LABEL}">{_text(what)}</th>'
        f'<td style="{PLAIN}">{_text(words)}</td></tr>'
        for what, words in rows
    )
    table = f'<table style="{TABLE}">{cells}</table>' if rows else ""
    tiles = "".join(
        _tile(picture, png, width)
        for picture, png in zip(pictures, _encoded([picture.rgb for picture in pictures], width), strict=True)
    )
    sheet = f'<div style="display:flex;flex-wrap:wrap;gap:8px;margin:6px 0">{tiles}</div>' if tiles else ""
    below = "".join(f'<div style="opacity:.8;font-style:italic">{_text(note)}</div>' for note in notes)
    return f'<div style="{FRAME}"><div style="font-weight:600">{_text(heading)}</div>{table}{sheet}{below}</div>'


def never_failing(heading: str, made: Callable[[], str]) -> str:
    """What `made` returns, or a card that says in words why it did not."""
    try:
        return made()
    except Exception as error:  # a repr must not take the notebook's cell with it
        return card(heading, [("can't be shown", f"{type(error).__name__}: {error}")])


def on_background(rgba: NDArray[Any], background: Sequence[float] = WHITE) -> NDArray[np.uint8]:
    """Premultiplied RGBA [H, W, 4] composited on a colour: straight RGB [H, W, 3]."""
    pixels = to_float(rgba)
    return to_bytes(pixels[..., :3] + (1.0 - pixels[..., 3:]) * np.asarray(background, dtype=np.float32))


def _shrunk(rgb: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """The picture with its longer side at most `side` pixels long, each the mean of those it covers."""
    height, width = rgb.shape[:2]
    longer = max(height, width)
    if longer <= side:
        return rgb
    pixels: NDArray[Any] = rgb.astype(np.float32)
    for axis, length in enumerate((height, width)):
        edges = np.linspace(0, length, max(1, round(length * side / longer)) + 1).astype(int)
        counts = np.diff(edges).reshape([-1 if a == axis else 1 for a in range(3)])
        pixels = np.add.reduceat(pixels, edges[:-1], axis=axis) / counts
    return (pixels + 0.5).astype(np.uint8)


def _encoded(pictures: Sequence[NDArray[np.uint8]], side: int) -> list[bytes]:
    """PNG files of all of them, `side` pixels long or as many as `MOST_BYTES` allows."""
    while True:
        files = [encode_png(_shrunk(rgb, side)) for rgb in pictures]
        size = sum(map(len, files))
        if size <= MOST_BYTES or side == 1:
            return files
        side = max(1, int(0.97 * side * math.sqrt(MOST_BYTES / size)))  # sizes go nearly with the number of pixels


def _tile(picture: Picture, png: bytes, width: int) -> str:
    address = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    words = _text(picture.title or picture.caption)
    caption = f'<figcaption style="{CAPTION}">{_text(picture.caption)}</figcaption>' if picture.caption else ""
    image = f'<img src="{address}" alt="{words}" title="{words}" style="{TILE}">'
    return f'<figure style="margin:0;width:{width}px">{image}{caption}</figure>'


def _text(words: str) -> str:
    """Escaped, of bounded length, and without what UTF-8 can't carry, such as the bytes of a path that is no text."""
    plain = words.encode("utf-8", "replace").decode()
    return escape(plain if len(plain) <= LONGEST else f"{plain[: LONGEST - 1]}…")
