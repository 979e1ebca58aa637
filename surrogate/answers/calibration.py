"""From how far predictions lie apart to how far they are off: intervals that hold for members that nobody learnt from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary import numbers
from catalogs.vocabulary.words import one_line
from surrogate.emulation.validation import SHARE, conformal_rank

FEWEST, FEWEST_FITTED = 3, 20  # members that calibrate at all, and that more than a constant is fitted to
AGREEMENT, CONSTANT, TREND = "agreement", "constant", "trend"  # what is expected by
CLEARLY = 0.3  # of the error at members left out, by which others than agreement alone must lower it
PENALTY = 1.0  # on squared weights, as of one member at the bounds
USUAL = 5.0  # dB, by which agreements differ: what a weight counts by
TINY = 1e-12

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Unseen:
    """Pictures of M members that were not learnt from, V of each.

    Attributes
    ----------
    points : (M, P) normalized parameters.
    agreements, truths : (M, V) of predictions with each other and with the truth, dB.
    """

    points: Array  # [M, P]
    agreements: Array  # [M, V]
    truths: Array  # [M, V]

    __repr__ = one_line

    def of(self, members: NDArray[np.bool_]) -> Unseen:
        """Some of the members, (M,) of them marked."""
        return Unseen(self.points[members], self.agreements[members], self.truths[members])


@dataclass(frozen=True)
class Line:
    """PSNR by agreement: `slope` x agreement + `constant`, plus a `trend` over the P normalized parameters, if there is one."""

    slope: float
    constant: float
    trend: tuple[float, ...] = ()

    @classmethod
    def of(cls, unseen: Unseen, form: str) -> Line:
        """By the members' means: a ridge regression with a trend; a fitted slope without, of few members slope 1, or 0."""
        agreements, truths = unseen.agreements.mean(1), unseen.truths.mean(1)  # [M]
        if form == TREND:
            features = np.column_stack([agreements / USUAL, unseen.points, np.ones(len(truths))])  # [M, P + 2]
            penalties = np.diag([*[PENALTY] * (features.shape[1] - 1), 0.0])
            weights = np.linalg.solve(features.T @ features + penalties, features.T @ truths)
            return cls(float(weights[0]) / USUAL, float(weights[-1]), tuple(weights[1:-1].tolist()))
        slope = float(form == AGREEMENT)
        if slope and len(agreements) >= FEWEST_FITTED and agreements.std() > TINY:
            slope = float(np.polyfit(agreements, truths, 1)[0])
        return cls(slope, float(np.median(unseen.truths - slope * unseen.agreements)))

    def expected(self, agreement: Any, point: Array) -> Any:
        """The PSNR, dB, to expect at a point (P,) where predictions agree as much (dB)."""
        trend = float(np.dot(self.trend, point)) if self.trend else 0.0
        return self.slope * agreement + self.constant + trend


@dataclass(frozen=True)
class Calibration:
    """The PSNR to expect, which is within `half` for a `share` of unseen pictures.

    Attributes
    ----------
    members : that calibrated it.
    off : the mean absolute error of such expectations, each member without itself, dB.
    """

    line: Line
    half: float
    share: float
    members: int
    off: float

    @classmethod
    def of(cls, unseen: Unseen) -> Calibration | None:
        """None for fewer than `FEWEST` members.

        Those left out decide whether agreement says nothing and, of `FEWEST_FITTED` members or more, whether there is a trend.
        Members, not pictures, are drawn independently, so the quantile is the `conformal_rank` over members, of residuals that a
        member's own pictures did not calibrate.
        """
        members, views = unseen.truths.shape
        if members < FEWEST:
            return None
        forms = (AGREEMENT, CONSTANT, TREND) if members >= FEWEST_FITTED else (AGREEMENT, CONSTANT)
        residuals = {form: _residuals(unseen, form) for form in forms}
        best = min(forms, key=lambda form: residuals[form].mean() / (1.0 if form == AGREEMENT else 1.0 - CLEARLY))
        half = float(np.sort(residuals[best].ravel())[conformal_rank(members) * views - 1])
        promised = min(SHARE, members / (members + 1))
        return cls(Line.of(unseen, best), half, promised, members, float(residuals[best].mean()))

    def to_json(self) -> dict[str, Any]:
        """JSON values, by attribute."""
        return asdict(self)

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Calibration:
        """The one of which `to_json` gave this; raises ValueError for damage."""
        values = {name: numbers.finite(record[name], name) for name in ("half", "share", "off")}
        line = record["line"]
        slopes = {name: numbers.finite(line[name], name) for name in ("slope", "constant")}
        trend = tuple(numbers.finite(v, "trend") for v in line["trend"])
        members = numbers.count(record["members"], "members")
        return cls(Line(**slopes, trend=trend), **values, members=members)


def _residuals(unseen: Unseen, form: str) -> Array:
    """Absolute errors (M, V) of expectations at each member's pictures, made without the member."""
    residuals = np.empty_like(unseen.truths)
    for member, point in enumerate(unseen.points):
        line = Line.of(unseen.of(np.arange(len(residuals)) != member), form)
        residuals[member] = np.abs(unseen.truths[member] - line.expected(unseen.agreements[member], point))
    return residuals
