"""How two pictures differ: a coloured map of it, and what it is in numbers."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation.metrics import WHITE, composite, decibels

COLOR_MAP = "inferno"  # perceptually uniform, readable in gray and without red-green vision; black is no difference
ENTRIES = 256
RANGES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # between which pictures in motion flicker least
SHOWN = 0.995  # of the pixels lie within the chosen range; a few bright ones would darken all the others


@dataclass(frozen=True, eq=False)
class Difference:
    """The absolute difference of two pictures, of each pixel that of the channel that differs most.

    The largest rather than the mean over channels, so that what differs in one colour alone is not shown at a third of it.

    Attributes
    ----------
    picture : (H, W, 3) float32, `COLOR_MAP` over `low` to `high`; what exceeds `high` has its last colour.
    low, high : the range that the colours span, in units of the pictures' [0, 1].
    psnr : dB, as `surrogate.evaluation.metrics.psnr` of the composited pictures: over all channels, at most 60.
    mean, maximum : of the map, over all pixels.
    """

    picture: NDArray[np.float32]  # [H, W, 3]
    low: float
    high: float
    psnr: float
    mean: float
    maximum: float


def difference_of(
    first: NDArray[np.float32],
    second: NDArray[np.float32],
    *,
    background: Sequence[float] = WHITE,
    high: float | None = None,
) -> Difference:
    """The difference of two pictures of equal size, each (H, W, 3), or (H, W, 4) premultiplied.

    Pictures with alpha are composited on `background` first, and all are cut to [0, 1].  `high` is where the colours end; None
    chooses the smallest of `RANGES` that holds nearly all pixels.  One core takes 2 ms for 256².

    Raises ValueError for other shapes, or a `high` that is not positive.
    """
    for picture in (first, second):
        if picture.ndim != 3 or picture.shape[2] not in (3, 4) or 0 in picture.shape:
            raise ValueError(f"a picture must be [H, W, 3] or [H, W, 4], got {picture.shape}")
    if first.shape[:2] != second.shape[:2]:
        raise ValueError(f"pictures of one size differ, got {first.shape[:2]} and {second.shape[:2]}")
    if high is not None and not 0.0 < high < np.inf:
        raise ValueError(f"high must be a positive difference, got {high}")
    one, other = _opaque(first, background), _opaque(second, background)  # [H, W, 3] each
    apart = one - other
    squared = float(np.vdot(apart, apart)) / apart.size
    np.abs(apart, out=apart)
    errors = np.maximum(np.maximum(apart[..., 0], apart[..., 1]), apart[..., 2])  # [H, W]
    chosen = _range(errors) if high is None else float(high)
    places = np.minimum(errors * np.float32(ENTRIES / chosen), ENTRIES - 1).astype(np.uint8)
    return Difference(
        picture=color_table().take(places, axis=0),
        low=0.0,
        high=chosen,
        psnr=decibels(squared),
        mean=float(errors.mean(dtype=np.float64)),
        maximum=float(errors.max()),
    )


@functools.cache
def color_table() -> NDArray[np.float32]:
    """The `ENTRIES` colours of the map, (256, 3), from no difference to `high` and beyond; read-only."""
    from matplotlib import colormaps

    table = colormaps[COLOR_MAP](np.arange(ENTRIES))[:, :3].astype(np.float32)  # by entry, whatever their number
    table.setflags(write=False)
    return table


def _opaque(picture: NDArray[np.float32], background: Sequence[float]) -> NDArray[np.float32]:
    if picture.shape[2] == 4:
        return composite(picture, background)
    return np.clip(np.ascontiguousarray(picture, np.float32), 0.0, 1.0)


def _range(errors: NDArray[np.float32]) -> float:
    place = int(SHOWN * (errors.size - 1))
    reached = float(np.partition(errors, place, axis=None)[place])
    return next((high for high in RANGES if high >= reached), RANGES[-1])
