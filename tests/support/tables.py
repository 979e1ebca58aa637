"""Tables of a written page."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def tables(page: str) -> list[list[int]]:
    """The number of cells in each row of each table of a page."""
    found: list[list[int]] = [[]]
    for line in page.splitlines():
        if line.startswith("|"):
            found[-1].append(line.count("|"))
        elif found[-1]:
            found.append([])
    return [widths for widths in found if widths]


def over_white(picture: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float64]:
    values = picture / 255.0 if picture.dtype == np.uint8 else picture.astype(np.float64)
    return np.clip(values[..., :3] + 1.0 - values[..., 3:], 0.0, 1.0)


def squared_error(first: NDArray, second: NDArray) -> float:
    return float(np.mean((over_white(first) - over_white(second)) ** 2))
