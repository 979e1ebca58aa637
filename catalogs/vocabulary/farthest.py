"""Farthest-point sampling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def farthest_points(points: NDArray[np.float64], count: int, first: int = 0) -> list[int]:
    """At most `count` rows of `points` (M, D): the `first`, then always the one farthest from those before.

    By Euclidean distance (Gonzalez 1985); of equally far rows the lowest.
    """
    rows = [first]
    distances = np.linalg.norm(points - points[first], axis=1)  # [M]
    while len(rows) < min(count, len(points)):
        rows.append(int(np.argmax(distances)))
        distances = np.minimum(distances, np.linalg.norm(points - points[rows[-1]], axis=1))
    return rows
