"""Points sampled in the volume, on which Gaussians may start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.words import one_line


@dataclass(frozen=True, eq=False)
class Points:
    """M sampled points: places in normalized coordinates (M, 3) and straight RGB (M, 3), or None where unknown."""

    places: NDArray[np.float64]  # [M, 3]
    colors: NDArray[np.float64] | None  # [M, 3]

    __repr__ = one_line
