"""From how far predictions lie apart to how far they are off: intervals that hold for members that nobody learnt from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary import numbers
from catalogs.vocabulary.words import one_line

SHARE = 0.9  # of unseen pictures that intervals are to hold
FEWEST, FEWEST_FITTED = 4, 20  # members that calibrate at all, and that more than a constant is fitted to
NEAREST = 4  # members that correct what is expected near them, by the median of their residuals
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
    """PSNR by agreement: `slope` x agreement + `constant`, plus what members near a point are off by, if any are given.

    Attributes
    ----------
    points, residuals : of those members, P parameters and one number each.
    """

    slope: float
    constant: float
    points: tuple[tuple[float, ...], ...] = ()
    residuals: tuple[float, ...] = ()

    @classmethod
    def of(cls, unseen: Unseen, *, by_agreement: bool, nearby: bool) -> Line:
        """Without `by_agreement` of slope 0, else fitted to the members' means where there are enough, or of slope 1."""
        agreements, truths = unseen.agreements.mean(1), unseen.truths.mean(1)  # [M]
        slope = float(by_agreement)
        if by_agreement and len(agreements) >= FEWEST_FITTED and agreements.std() > TINY:
            slope = float(np.polyfit(agreements, truths, 1)[0])
        constant = float(np.median(unseen.truths - slope * unseen.agreements))
        if not nearby:
            return cls(slope, constant)
        residuals = truths - slope * agreements - constant
        return cls(slope, constant, tuple(map(tuple, unseen.points.tolist())), tuple(residuals.tolist()))

    def expected(self, agreement: Any, point: Array) -> Any:
        """The PSNR, dB, to expect at a point (P,) where predictions agree as much (dB)."""
        return self.slope * agreement + self.constant + self._correction(point)

    def _correction(self, point: Array) -> float:
        if not self.residuals:
            return 0.0
        distances = ((np.array(self.points) - point) ** 2).sum(1)  # [M]
        return float(np.median(np.array(self.residuals)[distances.argsort(kind="stable")[:NEAREST]]))


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

        Of `FEWEST_FITTED` members or more, those left out also decide whether agreement, members near by, or both are asked.
        Members, not pictures, are drawn independently, so the quantile is that of conformal prediction over members (Lei et al.
        2018, "Distribution-free predictive inference for regression", section 2.2), of residuals that a member's own pictures
        did not calibrate.  Of fewer than nine members it is the greatest, which holds for M of M + 1.
        """
        members, views = unseen.truths.shape
        if members < FEWEST:
            return None
        forms = [(True, False)] if members < FEWEST_FITTED else [(True, False), (True, True), (False, True)]
        tried = [(_residuals(unseen, *form), form) for form in forms]
        residuals, (by_agreement, nearby) = min(tried, key=lambda one: float(one[0].mean()))
        rank = min(math.ceil((members + 1) * SHARE - TINY), members)
        half = float(np.sort(residuals.ravel())[rank * views - 1])
        line = Line.of(unseen, by_agreement=by_agreement, nearby=nearby)
        return cls(line, half, min(SHARE, members / (members + 1)), members, float(residuals.mean()))

    def to_json(self) -> dict[str, Any]:
        """JSON values, by attribute."""
        return asdict(self)

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Calibration:
        """The one of which `to_json` gave this; raises ValueError for damage."""
        values = {name: numbers.finite(record[name], name) for name in ("half", "share", "off")}
        line = record["line"]
        slopes = {name: numbers.finite(line[name], name) for name in ("slope", "constant")}
        points = tuple(tuple(numbers.finite(v, "points") for v in point) for point in line["points"])
        residuals = tuple(numbers.finite(v, "residuals") for v in line["residuals"])
        if len(points) != len(residuals) or len({len(point) for point in points}) > 1:
            raise ValueError(f"{len(points)} points of one length must have as many residuals, got {len(residuals)}")
        members = numbers.count(record["members"], "members")
        return cls(Line(**slopes, points=points, residuals=residuals), **values, members=members)


def _residuals(unseen: Unseen, by_agreement: bool, nearby: bool) -> Array:
    """Absolute errors (M, V) of expectations at each member's pictures, made without the member."""
    residuals = np.empty_like(unseen.truths)
    for member, point in enumerate(unseen.points):
        line = Line.of(unseen.of(np.arange(len(residuals)) != member), by_agreement=by_agreement, nearby=nearby)
        residuals[member] = np.abs(unseen.truths[member] - line.expected(unseen.agreements[member], point))
    return residuals
