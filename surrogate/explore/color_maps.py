"""Colour maps to choose from, as control points of a transfer function."""

from __future__ import annotations

import numpy as np

NAMES = ("viridis", "plasma", "inferno", "cividis", "turbo", "coolwarm", "gray")
POINTS = 33  # between them the smooth maps differ from their control points by less than 0.03


def color_points(name: str, low: float, high: float) -> tuple[tuple[float, float, float, float], ...]:
    """`POINTS` control points (value, red, green, blue) of matplotlib's colour map over field values `low` to `high`.

    Raises ValueError for a name that is not in `NAMES`.
    """
    if name not in NAMES:
        raise ValueError(f"the colour map must be one of {', '.join(NAMES)}, got {name!r}")
    from matplotlib import colormaps

    places = np.linspace(0.0, 1.0, POINTS)
    rows = np.column_stack([low + places * (high - low), colormaps[name](places)[:, :3]])  # [POINTS, 4]
    return tuple((value, red, green, blue) for value, red, green, blue in rows.tolist())
