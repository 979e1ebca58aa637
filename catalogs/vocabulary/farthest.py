"""Some of many points, as far apart as can be found quickly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def farthest_points(points: NDArray[np.float64], count: int, first: int = 0) -> list[int]:
    """`count` rows of `points` (M, D), all where there are no more: the `first`, then always the farthest from those taken.

    Farthest-point sampling (Gonzalez 1985), by Euclidean distance; the lowest row of equals.
    """
    taken = [first]
    distances = np.linalg.norm(points - points[first], axis=1)  # [M]
    while len(taken) < min(count, len(points)):
        taken.append(int(np.argmax(distances)))
        distances = np.minimum(distances, np.linalg.norm(points - points[taken[-1]], axis=1))
    return taken
