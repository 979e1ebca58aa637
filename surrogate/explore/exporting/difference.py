"""The difference of two images, as a coloured map and in numbers."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation.metrics import decibels

COLOR_MAP = "inferno"  # perceptually uniform, readable in gray and without red-green vision; black where both agree
ENTRIES = 256
RANGES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # between which pictures in motion flicker least
SHOWN = 0.995  # of the pixels lie within the chosen range; a few bright ones would darken all the others


@dataclass(frozen=True, eq=False, repr=False)
class Difference:
    """The absolute difference of two pictures, at each pixel the largest over the channels.

    A mean over channels would show what differs in one colour alone at a third of its size.

    Attributes
    ----------
    picture : (H, W, 3) float32, `COLOR_MAP` over 0 to `high`; what exceeds `high` has its last colour.
    high : where the colours end, in units of the pictures' [0, 1].
    psnr : dB, as `surrogate.evaluation.metrics.psnr`: over all channels, at most 60.
    maximum : of the map, over all pixels.
    """

    picture: NDArray[np.float32]  # [H, W, 3]
    high: float
    psnr: float
    maximum: float


def difference_of(first: NDArray[np.float32], second: NDArray[np.float32]) -> Difference:
    """The difference of two pictures of equal size, each (H, W, 3), cut to [0, 1] first.

    The colours end at the smallest of `RANGES` that holds nearly all pixels.  One core takes 2 ms for 256².  Raises ValueError
    for other shapes.
    """
    if first.ndim != 3 or first.shape[2] != 3 or 0 in first.shape or first.shape != second.shape:
        raise ValueError(f"pictures [H, W, 3] of one size differ, got {first.shape} and {second.shape}")
    apart = np.clip(first, 0.0, 1.0) - np.clip(second, 0.0, 1.0)
    squared = float(np.vdot(apart, apart)) / apart.size
    np.abs(apart, out=apart)
    errors = np.maximum(np.maximum(apart[..., 0], apart[..., 1]), apart[..., 2])  # [H, W]
    high = reach(errors)
    places = np.minimum(errors * np.float32(ENTRIES / high), ENTRIES - 1).astype(np.uint8)
    return Difference(color_table().take(places, axis=0), high, decibels(squared), float(errors.max()))


def reach(map_: NDArray[np.floating]) -> float:
    """The smallest of `RANGES` that holds nearly all values of a map (H, W)."""
    place = int(SHOWN * (map_.size - 1))
    reached = float(np.partition(map_, place, axis=None)[place])
    return next((high for high in RANGES if high >= reached), RANGES[-1])


@functools.cache
def color_table() -> NDArray[np.float32]:
    """The `ENTRIES` colours of the map, (256, 3), from no difference to `high` and beyond; read-only."""
    from matplotlib import colormaps

    table = colormaps[COLOR_MAP](np.arange(ENTRIES))[:, :3].astype(np.float32)  # by entry, whatever their number
    table.setflags(write=False)
    return table
