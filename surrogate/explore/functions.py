"""Transfer functions from outside, in the terms that catalogs store them in: checked before anything is drawn with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from catalogs.vocabulary.appearance import TransferFunction

MOST_POINTS = 256  # of opacity, and of colour
FARTHEST = 100.0  # widths of the base function that a control point may lie from its ends


def function_of(record: Any, base: TransferFunction) -> TransferFunction:
    """The transfer function of JSON values: `opacity_points`, and where they are another function's than `base` the rest.

    Raises ValueError naming what is wrong: too many points, values that don't increase, are not finite or lie too far away.
    """
    names = [field.name for field in fields(TransferFunction)]
    if not isinstance(record, Mapping) or "opacity_points" not in record or not set(record) <= set(names):
        raise ValueError(f"a transfer function is an object of opacity_points and perhaps {' and '.join(names[::2])}")
    for name in names[:2]:
        points = record.get(name, ())
        if isinstance(points, list | tuple) and len(points) > MOST_POINTS:
            raise ValueError(f"a transfer function has at most {MOST_POINTS} {name}, got {len(points)}")
    function = TransferFunction(**{name: record.get(name, getattr(base, name)) for name in names})
    (low, high), (first, last) = base.bounds, function.bounds
    reach = FARTHEST * (high - low)
    if first < low - reach or last > high + reach:
        raise ValueError(
            f"control points lie from {first:g} to {last:g}, too far from the values {low:g} to {high:g} of this run"
        )
    return function


def record_of_function(function: TransferFunction) -> dict[str, Any]:
    """JSON values of which `function_of` makes the function."""
    return {
        "color_points": [list(point) for point in function.color_points],
        "opacity_points": [list(point) for point in function.opacity_points],
        "opacity_unit_distance": function.opacity_unit_distance,
    }
