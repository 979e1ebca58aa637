"""Values of the members' fields that the hook sampled: at points where something is seen, and all over the box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.parameters import SPLITS, ParameterSpace
from surrogate.gaussians import Normalization


@dataclass(frozen=True, eq=False)
class FieldPoints:
    """A field's values at M points of K members, one member's after the other's.

    Attributes
    ----------
    names : (K,) of the members that have any points.
    parameters : (K, P) float32, their simulation parameters, normalized to [-1, 1] over the bounds.
    places : (M, 3) float32, in the Gaussians' coordinates.
    values : (M,) float64, in the field's unit.
    members : (M,) int64, the row of each point's member.
    evenly : (M,) bool, whether a point is one of those that fill the box evenly; the others lie where something is seen.
    """

    names: tuple[str, ...]
    parameters: NDArray[np.float32]  # [K, P]
    places: NDArray[np.float32]  # [M, 3]
    values: NDArray[np.float64]  # [M]
    members: NDArray[np.int64]  # [M]
    evenly: NDArray[np.bool_]  # [M]

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        return f"<FieldPoints: {len(self):,} of {len(self.names)} members, {int(self.evenly.sum()):,} of them evenly>"

    def sample(
        self, member: int, count: int, random: np.random.Generator, *, even_share: float = 0.5
    ) -> NDArray[np.int64]:
        """`count` points of the member in row `member`, (count,) indices, some maybe twice.

        About `even_share` of them are even ones; all are of the kind that the member has, where it has one only.  Raises
        IndexError for a row that is none.
        """
        if not 0 <= member < len(self.names):
            raise IndexError(f"there are points of {len(self.names)} members, and none of row {member}")
        first, last = np.searchsorted(self.members, [member, member + 1])
        middle = last - int(self.evenly[first:last].sum())
        wanted = random.random(count) < even_share  # [count]
        even = (wanted | (middle == first)) & (middle < last)  # [count]
        low, high = np.where(even, middle, first), np.where(even, last, middle)  # [count]
        return low + (random.random(count) * (high - low)).astype(np.int64)


def field_points(
    catalog: Catalog,
    field: str,
    normalization: Normalization,
    space: ParameterSpace,
    splits: Sequence[str] = ("train",),
) -> FieldPoints:
    """The points of all members of these splits, in the order of the catalog.

    `field` is the name of one that the catalog shows, or "" for the only one.  Members without a summary of it are left out, and
    those that were rendered before there were even points have none of these.  Raises ValueError for a split or a field that is
    none, and for a damaged summary.
    """
    unknown = sorted(set(splits) - set(SPLITS))
    if unknown or not splits:
        raise ValueError(f"splits must be some of {', '.join(SPLITS)}, got {', '.join(unknown) or 'none'}")
    if field and field not in catalog.plan.fields:
        raise ValueError(f"{catalog.path} shows {', '.join(catalog.plan.fields) or 'no field'}, and no field {field!r}")
    sampled = [
        (member, one) for member in catalog.members if member.split in splits if (one := _summary(member, field))
    ]
    parameters = [[member.parameters[name] for name in space.names] for member, _ in sampled]  # [K][P]
    places = [p for _, summary in sampled for p in (summary.points, summary.even_points)]  # [., 3] each
    values = [v for _, summary in sampled for v in (summary.point_values, summary.even_values)]  # [.] each
    counts = np.array([len(v) for v in values], dtype=np.int64)  # [2 K]
    return FieldPoints(
        names=tuple(member.name for member, _ in sampled),
        parameters=space.normalize(np.reshape(parameters, (len(sampled), len(space)))).astype(np.float32),
        places=normalization.points(np.concatenate([np.empty((0, 3)), *places])).astype(np.float32),
        values=np.concatenate([np.empty(0), *values]),
        members=np.repeat(np.arange(2 * len(sampled)) // 2, counts),
        evenly=np.repeat(np.arange(2 * len(sampled)) % 2 == 1, counts),
    )


def _summary(member: Member, field: str) -> FieldSummary | None:
    """The summary of a field that the member has points of."""
    summary = member.summary(field)
    return summary if summary is not None and len(summary.points) + len(summary.even_points) else None
