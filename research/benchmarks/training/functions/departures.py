"""The tested transfer functions: seven departures from the trained one, and a narrow peak, which is reported separately."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.evaluation.novelty import SeenValues

TRAINED, PEAK = "trained", "narrow peak"
MOST_OPAQUE = 0.95
FEWEST = 10  # opacity points; functions with fewer get more
MORE = 16
SHARES = (0.14, 0.36, 0.66, 0.97)  # shares of the visible amount below the marks, as in cloverleaf
PEAK_WIDTH = 0.01  # of the function's range, to either side
PEAK_OPACITY = 0.8


@dataclass(frozen=True)
class Marks:
    """The field values at which functions are changed: `low` and `lower` below `middle`, and `high`."""

    low: float
    lower: float
    middle: float
    high: float

    @classmethod
    def of(cls, seen: SeenValues, base: TransferFunction) -> Marks:
        """The values below which `SHARES` of the base's visible amount in training members lie; raises ValueError for a
        base without."""
        return cls(*(seen.quantile(base, share) for share in SHARES))

    @property
    def width(self) -> float:
        """Width of the bump in the middle."""
        return (self.high - self.middle) / 1.5


KNOWN_MARKS: Mapping[str, Marks] = {"cloverleaf": Marks(1.2, 2.0, 3.0, 4.5)}  # by scene, in the field's unit


def departures(base: TransferFunction, marks: Marks) -> dict[str, TransferFunction]:
    """The seven functions and the peak, by name, at the control points of the base's opacity, at more where it has few."""
    values = places(base)  # [P]
    opacities = base.opacities(values)  # [P]
    rising = (values - values[0]) / (values[-1] - values[0])  # [P]
    bump = np.exp(-(((values - marks.middle) / marks.width) ** 2))  # [P]
    changed = {
        "half": opacities / 2.0,
        "double": 1.0 - (1.0 - opacities) ** 2,
        "ramp": 0.6 * rising,
        "high": np.where(values > marks.high, opacities, 0.0),
        "low": np.where(values < marks.low, 0.5, np.where(values < marks.lower, 0.2, 0.0)),
        "middle": 0.6 * bump,
    }
    functions = {name: _with_opacities(base, values, of) for name, of in changed.items()}
    turned = tuple((value, blue, red, green) for value, red, green, blue in base.color_points)
    functions["colours"] = replace(_with_opacities(base, values, opacities), color_points=turned)
    return {**functions, PEAK: _peak(base, marks.middle)}


def appearance_name(function: str) -> str:
    """The name of the appearance that shows a function."""
    return function.replace(" ", "-")


def places(base: TransferFunction) -> NDArray[np.float64]:
    """The field values (P,) of the base's opacity points, and evenly spaced ones where these are few."""
    own = np.array([value for value, _ in base.opacity_points])
    return own if len(own) >= FEWEST else np.unique(np.concatenate([own, np.linspace(own[0], own[-1], MORE)]))


def _with_opacities(
    base: TransferFunction, values: NDArray[np.float64], opacities: NDArray[np.float64]
) -> TransferFunction:
    capped = np.clip(opacities, 0.0, MOST_OPAQUE)
    return replace(base, opacity_points=tuple(zip(values.tolist(), capped.tolist(), strict=True)))


def _peak(base: TransferFunction, center: float) -> TransferFunction:
    """A function that is opaque at one value, and transparent a hundredth of the range away from it."""
    low, high = base.bounds
    width = PEAK_WIDTH * (high - low)
    points = ((center - width, 0.0), (center, PEAK_OPACITY), (center + width, 0.0))
    inside = tuple(point for point in points if low < point[0] < high)
    return replace(base, opacity_points=((low, 0.0), *inside, (high, 0.0)))
