"""Extinction and emission of a transfer function, tabulated at field values: by the C++ kernel, and by its readable twin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import native
from catalogs.appearance import TransferFunction

SAMPLES = 32  # of the transfer function between two neighbouring values
MOST_OPAQUE = 0.999  # an opacity of 1 would be an infinite extinction


def extinction_table(function: TransferFunction, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Extinction, and extinction times colour, at B increasing values: (B, 4), per opacity unit distance of the function.

    Each is the mean over the neighbouring intervals, weighted by the hat function of linear interpolation: 1 at the value and 0 at
    its neighbours.
    """
    points = np.array(function.color_points), np.array(function.opacity_points)  # [P, 4], [Q, 2]
    return native.extinction_table(values, *points, SAMPLES, MOST_OPAQUE)


def extinction_table_reference(function: TransferFunction, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same in numpy: the definition that the kernel is tested against."""
    inside = (np.arange(SAMPLES) + 0.5) / SAMPLES  # [S], places between two values
    fine = values[:-1, None] + np.diff(values)[:, None] * inside  # [B - 1, S]
    extinctions = -np.log1p(-np.minimum(function.opacities(fine), MOST_OPAQUE))  # [B - 1, S]
    columns = np.concatenate([extinctions[..., None], extinctions[..., None] * function.colors(fine)], axis=2)
    lengths = np.diff(values)[:, None]  # [B - 1, 1]
    # [B - 1, 4] each: to the upper and to the lower value of each interval
    rising = lengths * np.einsum("s,bsc->bc", inside, columns) / SAMPLES
    falling = lengths * np.einsum("s,bsc->bc", 1.0 - inside, columns) / SAMPLES
    total = np.pad(rising, ((1, 0), (0, 0))) + np.pad(falling, ((0, 1), (0, 0)))  # [B, 4]
    weight = np.pad(lengths, ((1, 0), (0, 0))) / 2.0 + np.pad(lengths, ((0, 1), (0, 0))) / 2.0  # [B, 1]
    return total / weight
