"""What measurements say about members that training never saw, and how far off that is.

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
from surrogate.explore.reliability.places import Place, base_name, place_of
from surrogate.model import Surrogate

# Of 1 to 15 the best at rows left out, see research/benchmarks/explorer/expectation.py.
NEAREST = 4  # measurements whose median is expected


@dataclass(frozen=True, eq=False, repr=False)
class Table:
    """The measurements of one family, R rows."""

    places: NDArray[np.float64]  # [R, P + V], as in `Place`
    view_psnr: NDArray[np.float64]  # [R, K], dB at up to K views; NaN for views that a row does not have
    members: NDArray[np.str_]  # [R], names
    appearances: NDArray[np.str_]  # [R], names
    unseen: NDArray[np.bool_]  # [R], whether of a validation member
    base: str  # the name of the base appearance

    @cached_property
    def psnr(self) -> NDArray[np.float64]:
        """Means over views, (R,)."""
        return np.nanmean(self.view_psnr, axis=1)

    def of(self, rows: NDArray[np.bool_]) -> Table:
        """Some of the rows, (R,) of them marked."""
        arrays = ("places", "view_psnr", "members", "appearances", "unseen")
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})


def predicted(
    places: NDArray[np.float64], values: NDArray[np.float64], place: NDArray[np.float64], nearest: int = NEAREST
) -> float:
    """The median of the `values` (R,) whose `places` (R, D) lie nearest to `place` (D,)."""
    steps = places - place  # [R, D]
    order = np.einsum("rd,rd->r", steps, steps).argsort(kind="stable")[:nearest]
    return float(np.median(values[order]))


def tables_of(measured: Sequence[Measurement], surrogate: Surrogate) -> dict[str, Table]:
    """The measurements by family."""
    rows: dict[str, list[tuple[Place, Measurement]]] = {}
    for one in measured:
        place = place_of(one.setting, surrogate)
        rows.setdefault(place.family, []).append((place, one))
    most = max((len(one.psnr) for one in measured), default=0)
    return {
        family: Table(
            np.array([place.values for place, _ in group]),
            np.array([one.psnr + (math.nan,) * (most - len(one.psnr)) for _, one in group]),
            np.array([one.member for _, one in group]),
            np.array([one.appearance for _, one in group]),
            np.array([one.split == "validation" for _, one in group]),
            base_name(surrogate),
        )
        for family, group in rows.items()
    }


def generalization_gap(table: Table, nearest: int = NEAREST) -> float | None:
    """By how many dB training members are better than validation members of the same appearance; None without such pairs.

    The median over validation members of the median of their nearest training members, less what was measured.
    """
    gaps = []
    for row in np.flatnonzero(table.unseen):
        alike = ~table.unseen & (table.appearances == table.appearances[row])
        if alike.any():
            around = predicted(table.places[alike], table.psnr[alike], table.places[row], nearest)
            gaps.append(around - table.psnr[row])
    return float(np.median(gaps)) if gaps else None


def adjusted(table: Table, otherwise: float | None, nearest: int = NEAREST) -> NDArray[np.float64]:
    """PSNR (R,) as if every member were one that training never saw; `otherwise` is the gap where the table has none itself."""
    own = generalization_gap(table, nearest)
    gap = (otherwise or 0.0) if own is None else own
    return np.where(table.unseen, table.psnr, table.psnr - gap)


def leave_one_out(table: Table, gap: float | None, nearest: int = NEAREST) -> NDArray[np.float64]:
    """What is expected (R,) at each row from rows of other members and, unless it shows the base, of other appearances.

    The gap is measured anew each time; `gap` serves where none can be.  NaN where no row is left.
    """
    expected = np.full(len(table.psnr), np.nan)
    for row in range(len(expected)):
        kept = _others(table, row)
        if kept.any():
            rest = table.of(kept)
            expected[row] = predicted(rest.places, adjusted(rest, gap, nearest), table.places[row], nearest)
    return expected


def reach(table: Table) -> float:
    """The largest distance to the nearest measurement at which an expectation was checked by `leave_one_out`; 0 where none was."""
    distances = [0.0]
    for row in range(len(table.psnr)):
        others = table.places[_others(table, row)]
        if len(others):
            distances.append(float(np.linalg.norm(others - table.places[row], axis=1).min()))
    return max(distances)


def _others(table: Table, row: int) -> NDArray[np.bool_]:
    """The rows (R,) of other members and, unless the row shows the base, of other appearances."""
    kept = table.members != table.members[row]
    if table.appearances[row] != table.base:
        kept &= table.appearances != table.appearances[row]
    return kept


def leave_one_out_error(table: Table, gap: float | None) -> float | None:
    """The mean absolute difference, dB, between `leave_one_out` and single pictures; None where nothing is left.

    Over all rows, or over validation members where it is larger.
    """
    expected = leave_one_out(table, gap)  # [R]
    known, taken_off = np.isfinite(expected), table.psnr - adjusted(table, gap)  # [R] each
    errors = np.abs(table.view_psnr - (taken_off + expected)[:, None])  # [R, K]
    means = [np.nanmean(errors[rows], axis=1).mean() for rows in (known, known & table.unseen) if rows.any()]
    return max(map(float, means), default=None)
