"""The world box that an ensemble's fields fit in, and the cameras around it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.scene import ViewPlan

if TYPE_CHECKING:
    from render.grids import Grid

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
TOLERANCE = 1e-5  # of the box's diagonal: coordinates that went through float32 still agree


def cameras_around(bounds: Box, views: ViewPlan) -> tuple[Camera, ...]:
    """The cameras of `views` around the sphere through the corners of `bounds`."""
    low, high = np.array(bounds)  # [3] each
    return views.cameras(((low + high) / 2.0).tolist(), float(np.linalg.norm(high - low)) / 2.0)


def box_of(grid: Grid) -> Box:
    """The grid's world box as plain numbers."""
    return checked_box(grid.bounds)


def box_around(boxes: Sequence[Box]) -> Box:
    """The world box that holds all boxes."""
    corners = np.array(boxes)  # [K, 2, 3]
    return checked_box((corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)))


def check_inside(own: Box, bounds: Box) -> None:
    """Raise ValueError where a member's box reaches out of the ensemble's: the fixed cameras may not see it whole."""
    low, high = np.array(bounds)  # [3] each
    own_low, own_high = np.array(own)
    slack = TOLERANCE * np.linalg.norm(high - low)
    if (own_low < low - slack).any() or (own_high > high + slack).any():
        raise ValueError(
            f"the member reaches from {_place(own_low)} to {_place(own_high)}, out of the ensemble's box from "
            f"{_place(low)} to {_place(high)}, which its cameras are set around. {_remedy(own, bounds)}"
        )


def _remedy(own: Box, bounds: Box) -> str:
    """The likely reason why a box reaches out of the ensemble's."""
    sides, others = (np.subtract(box[1], box[0]) for box in (own, bounds))
    if np.allclose(np.sort(sides), np.sort(others), rtol=1e-3) and not np.allclose(sides, others, rtol=1e-3):
        return "Its sides are those of the box in another order: say what the array's axes are, such as dims=('x', 'y', 'z')"
    return "Check spacing and origin, or make a new catalog with bounds= that hold every member"


def is_smaller(own: Box, bounds: Box) -> bool:
    """True if a member's box leaves more than a hundredth of the ensemble's, along some axis, empty."""
    low, high = np.array(bounds)
    own_low, own_high = np.array(own)
    return bool((np.abs(own_low - low) + np.abs(own_high - high) > 0.01 * (high - low)).any())


def checked_box(bounds: Any) -> Box:
    """`bounds` as plain numbers; raises ValueError where it is not a box."""
    try:
        box = np.array(bounds, dtype=np.float64)  # [2, 3]
    except (TypeError, ValueError):
        box = np.empty(0)
    if box.shape != (2, 3) or not np.isfinite(box).all() or not (box[0] < box[1]).all():
        raise ValueError(f"bounds must be ((x, y, z) low, (x, y, z) high) with low < high, got {bounds}")
    (a, b, c), (d, e, f) = box.tolist()
    return (a, b, c), (d, e, f)


def same_box(first: Box, second: Box) -> bool:
    """True if two boxes agree within the tolerance."""
    low, high = np.array(second)
    return bool(np.abs(np.array(first) - np.array(second)).max() <= TOLERANCE * np.linalg.norm(high - low))


def _place(point: Any) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in point) + ")"
