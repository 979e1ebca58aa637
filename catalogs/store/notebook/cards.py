"""Cards for notebooks: facts and small images as self-contained HTML.

Colours are inherited and lines are translucent, for light and dark themes.  All style is inline, because untrusted notebooks lose
style sheets.  All text is escaped.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import encode_png, to_bytes, to_float

WHITE = (1.0, 1.0, 1.0)
TILE_WIDTH = 104  # pixels
LONGEST = 300  # characters of one fact

FRAME = "font:13px/1.5 system-ui,sans-serif;max-width:60em;overflow-wrap:anywhere"
PLAIN = "background:transparent;border:0;padding:1px 12px 1px 0;text-align:left;vertical-align:top;white-space:normal"
LABEL = f"{PLAIN};opacity:.7;font-weight:normal;white-space:nowrap"
TILE = "display:block;box-sizing:border-box;width:100%;height:auto;margin:0;border-radius:4px;border:1px solid rgba(128,128,128,.4)"
CAPTION = "opacity:.7;font-size:11px;line-height:1.3"
TABLE = "border-collapse:collapse;border:0;margin:4px 0;font:inherit;color:inherit"


@dataclass(frozen=True, eq=False)
class CardImage:
    """An image on a card: straight RGB [H, W, 3] uint8, the caption below it and its tooltip."""

    rgb: NDArray[np.uint8] = field(repr=False)
    caption: str = ""
    title: str = ""


def card(
    heading: str,
    rows: Sequence[tuple[str, str]],
    images: Sequence[CardImage] = (),
    notes: Sequence[str] = (),
    *,
    width: int = TILE_WIDTH,
) -> str:
    """A card of a heading, a table of (name, value), a row of images `width` pixels wide, and notes below."""
    cells = "".join(
        f'<tr style="background:transparent"><th style="{LABEL}">{_text(name)}</th>'
        f'<td style="{PLAIN}">{_text(value)}</td></tr>'
        for name, value in rows
    )
    table = f'<table style="{TABLE}">{cells}</table>' if rows else ""
    tiles = "".join(_tile(image, width) for image in images)
    sheet = f'<div style="display:flex;flex-wrap:wrap;gap:8px;margin:6px 0">{tiles}</div>' if tiles else ""
    below = "".join(f'<div style="opacity:.8;font-style:italic">{_text(note)}</div>' for note in notes)
    return f'<div style="{FRAME}"><div style="font-weight:600">{_text(heading)}</div>{table}{sheet}{below}</div>'


def never_failing(heading: str, make: Callable[[], str]) -> str:
    """The result of `make`, or a card with its exception."""
    try:
        return make()
    except Exception as error:  # a repr must not take the notebook's cell with it
        return card(heading, [("can't be shown", f"{type(error).__name__}: {error}")])


def on_background(rgba: NDArray[Any], background: Sequence[float] = WHITE) -> NDArray[np.uint8]:
    """Premultiplied RGBA [H, W, 4] composited on a colour: straight RGB [H, W, 3]."""
    pixels = to_float(rgba)
    return to_bytes(pixels[..., :3] + (1.0 - pixels[..., 3:]) * np.asarray(background, dtype=np.float32))


def _shrunk(rgb: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """The image with its longer side at most `side` pixels long, by averages."""
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


def _tile(image: CardImage, width: int) -> str:
    address = f"data:image/png;base64,{base64.b64encode(encode_png(_shrunk(image.rgb, width))).decode()}"
    title = _text(image.title or image.caption)
    caption = f'<figcaption style="{CAPTION}">{_text(image.caption)}</figcaption>' if image.caption else ""
    picture = f'<img src="{address}" alt="{title}" title="{title}" style="{TILE}">'
    return f'<figure style="margin:0;width:{width}px">{picture}{caption}</figure>'


def _text(text: str) -> str:
    """Escaped, of bounded length, and valid UTF-8."""
    plain = text.encode("utf-8", "replace").decode()
    return escape(plain if len(plain) <= LONGEST else f"{plain[: LONGEST - 1]}…")
