"""Calibration: the error at members that training never saw, estimated from measurements, and the error of such estimates.

Training members are predicted better than others because their parameters were seen.  This generalization gap, measured where both
show the same appearance, is subtracted from what was measured at training members.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surrogate.explore.reliability.measuring import Measurement
from surrogate.explore.reliability.points import base_name, point_of
from surrogate.model import Surrogate

# Of 1 to 15 the best at rows left out.
NEAREST = 4  # measurements whose median is expected
SLACK = 1.0 + 1e-9  # distances went through decimals


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredFamily:
    """The measurements of one family, R rows, and the errors to expect elsewhere."""

    points: NDArray[np.float64]  # [R, P + V], as in `SettingPoint`
    view_psnr: NDArray[np.float64]  # [R, K], dB at up to K views; NaN for views that a row does not have
    members: NDArray[np.str_]  # [R], names
    appearances: NDArray[np.str_]  # [R], names
    unseen: NDArray[np.bool_]  # [R], whether of a validation member
    base: str  # the name of the base appearance
    seen_views: bool  # whether training learnt from some of the views
    base_gap: float | None = None  # the gap of the base appearance, for families that have none themselves
    nearest: int = NEAREST

    @cached_property
    def psnr(self) -> NDArray[np.float64]:
        """Means over views, (R,)."""
        return np.nanmean(self.view_psnr, axis=1)

    def of(self, rows: NDArray[np.bool_]) -> MeasuredFamily:
        """Some of the rows, (R,) of them marked."""
        arrays = ("points", "view_psnr", "members", "appearances", "unseen")
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})

    @cached_property
    def gap(self) -> float | None:
        """By how many dB training members are better than validation members of the same appearance; None without such pairs.

        The median over validation members of the median of their nearest training members, less what was measured.
        """
        gaps = []
        for row in np.flatnonzero(self.unseen):
            alike = ~self.unseen & (self.appearances == self.appearances[row])
            if alike.any():
                gaps.append(self._median(self.points[alike], self.psnr[alike], self.points[row]) - self.psnr[row])
        return float(np.median(gaps)) if gaps else None

    @cached_property
    def adjusted(self) -> NDArray[np.float64]:
        """PSNR (R,) as if training had seen none of the members."""
        gap = (self.base_gap or 0.0) if self.gap is None else self.gap
        return np.where(self.unseen, self.psnr, self.psnr - gap)

    def expected_at(self, point: NDArray[np.float64]) -> float:
        """PSNR at `point` (P + V,), dB: the median of the nearest adjusted measurements."""
        return self._median(self.points, self.adjusted, point)

    @cached_property
    def left_out(self) -> NDArray[np.float64]:
        """PSNR (R,) expected at each row from rows of other members and, unless it shows the base, of other appearances.

        The gap is measured anew each time.  NaN where no row is left.
        """
        rests = [self._others(row) for row in range(len(self.psnr))]
        rows = enumerate(rests)
        return np.array([self.of(rest).expected_at(self.points[row]) if rest.any() else math.nan for row, rest in rows])

    @cached_property
    def error(self) -> float | None:
        """The mean absolute difference, dB, between `left_out` and single images; None where no row is left.

        Over all rows, or over validation members where it is larger.
        """
        errors = np.abs(self.view_psnr - (self.psnr - self.adjusted + self.left_out)[:, None])  # [R, K]
        finite = np.isfinite(self.left_out)  # [R]
        means = [np.nanmean(errors[rows], axis=1).mean() for rows in (finite, finite & self.unseen) if rows.any()]
        return max(map(float, means), default=None)

    @cached_property
    def reach(self) -> float:
        """The largest distance to the nearest measurement at which an expectation was checked; 0 where none was."""
        distances = [0.0]
        for row, point in enumerate(self.points):
            others = self.points[self._others(row)]
            distances += [float(np.linalg.norm(others - point, axis=1).min())] if len(others) else []
        return max(distances)

    def reaches(self, point: NDArray[np.float64]) -> bool:
        """True if an expectation at `point` (P + V,) was checked from as far away as this is."""
        return float(np.linalg.norm(self.points - point, axis=1).min()) <= max(self.reach * SLACK, 1e-9)

    def shows(self, visualization: NDArray[np.float64]) -> bool:
        """True if visualization parameters (V,), as in a point, lie between those of the points."""
        measured = self.points[:, self.points.shape[1] - len(visualization) :]  # [R, V]
        return bool(
            ((measured.min(axis=0) <= visualization + 1e-9) & (visualization - 1e-9 <= measured.max(axis=0))).all()
        )

    def _others(self, row: int) -> NDArray[np.bool_]:
        """The rows (R,) of other members and, unless the row shows the base, of other appearances."""
        others = self.members != self.members[row]
        return others if self.appearances[row] == self.base else others & (self.appearances != self.appearances[row])

    def _median(self, points: NDArray[np.float64], values: NDArray[np.float64], point: NDArray[np.float64]) -> float:
        """The median of the `values` (N,) whose `points` (N, D) lie nearest to `point` (D,)."""
        steps = points - point  # [N, D]
        order = np.einsum("nd,nd->n", steps, steps).argsort(kind="stable")[: self.nearest]
        return float(np.median(values[order]))


def families_of(
    measured: Sequence[Measurement], surrogate: Surrogate, nearest: int = NEAREST
) -> dict[tuple[str, str], MeasuredFamily]:
    """The measurements by `SettingPoint.family` and `SettingPoint.drawn_by`."""
    rows: dict[tuple[str, str], list[tuple[NDArray[np.float64], Measurement]]] = {}
    for one in measured:
        point = point_of(one.setting, surrogate)
        rows.setdefault((point.family, point.drawn_by), []).append((point.values, one))
    most, base = max((len(one.psnr) for one in measured), default=0), base_name(surrogate)
    families = {
        key: MeasuredFamily(
            np.array([values for values, _ in group]),
            np.array([one.psnr + (math.nan,) * (most - len(one.psnr)) for _, one in group]),
            np.array([one.member for _, one in group]),
            np.array([one.appearance for _, one in group]),
            np.array([one.split == "validation" for _, one in group]),
            base,
            any(one.seen_views for _, one in group),
            nearest=nearest,
        )
        for key, group in rows.items()
    }
    gaps = {drawn_by: family.gap for (name, drawn_by), family in families.items() if name == base}
    return {key: replace(family, base_gap=gaps.get(key[1])) for key, family in families.items()}
