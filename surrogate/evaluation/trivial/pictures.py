"""Trivial predictors of unseen parameters: mixtures of the training members' stored pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from catalogs.cameras import Camera
from catalogs.catalog import Catalog, Member
from surrogate.evaluation.cases import Case
from surrogate.evaluation.predictor import Draw
from surrogate.evaluation.trivial.interpolation import Rule

SAME_VIEW_DEGREES = 0.5


@dataclass(frozen=True, eq=False)
class MemberMixtures:
    """Predicts unseen parameters by weighted sums of the training members' pictures at the same view.

    It may use every view of those M `members`, also those that the surrogate never saw.  Where a member lacks a view, its nearest
    one by viewing direction stands in.
    """

    catalog: Catalog
    appearance: str
    members: Sequence[Member]
    rules: Sequence[Rule]

    @property
    def names(self) -> list[str]:
        """See `Predictor`."""
        return [rule.name for rule in self.rules]

    def batches(self, cases: Sequence[Case]) -> Iterator[tuple[Sequence[Case], Draw]]:
        """See `Predictor`; view by view, so that no more than one picture of each member is in memory."""
        known, wanted = self._normalized(self.members), self._normalized([case.member for case in cases])
        weights = np.stack([rule.weights(known, wanted) for rule in self.rules], axis=1)  # [T, K, M]
        rows = dict(zip(cases, weights.astype(np.float32), strict=True))
        batches: dict[tuple[int, ...], list[Case]] = {}
        for case, views in zip(cases, nearest_views(self.members, [c.camera for c in cases])[0].tolist(), strict=True):
            batches.setdefault(tuple(views), []).append(case)
        for views, batch in batches.items():
            yield batch, partial(_mixed, rows, self._pictures(views))

    def borrowed_degrees(self, cases: Sequence[Case]) -> float:
        """The largest angle between a wanted view and one that stands in for it; 0 where every member has all views."""
        worst = float(nearest_views(self.members, [case.camera for case in cases])[1].max(initial=0.0))
        return worst if worst > SAME_VIEW_DEGREES else 0.0

    def _pictures(self, views: Sequence[int]) -> NDArray[np.float32]:
        """One picture of each member, (M, H, W, 4)."""
        with ThreadPoolExecutor(2) as pool:
            loaded = pool.map(
                lambda member, view: self.catalog.image(member, self.appearance, view), self.members, views
            )
            return np.stack(list(loaded)).astype(np.float32) / 255.0

    def _normalized(self, members: Sequence[Member]) -> NDArray[np.float64]:
        space = self.catalog.plan.space
        return np.array([space.normalize([m.parameters[n] for n in space.names]) for m in members])  # [N, P]


def _mixed(rows: dict[Case, NDArray[np.float32]], pictures: NDArray[np.float32], case: Case) -> NDArray[np.float32]:
    mixed = rows[case] @ pictures.reshape(len(pictures), -1)  # [K, H * W * 4]
    return np.clip(mixed, 0.0, 1.0).reshape(-1, *pictures.shape[1:])


def nearest_views(
    members: Sequence[Member], cameras: Sequence[Camera]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Each member's view that is most like each camera, (T, M), and the largest angle between them in degrees, (T,)."""
    found: dict[int, tuple[NDArray[np.int64], NDArray[np.float64]]] = {}  # by the cameras, which members share
    forwards, ups = _axes(cameras)  # [T, 3]
    for member in members:
        if id(member.cameras) not in found:
            own_forwards, own_ups = _axes(member.cameras)  # [V, 3]
            cosines = forwards @ own_forwards.T  # [T, V]
            # Directions alone don't tell a camera from the same one rolled about its axis.
            best = (cosines + 1e-3 * ups @ own_ups.T).argmax(axis=1)
            found[id(member.cameras)] = best, np.clip(cosines[np.arange(len(best)), best], -1.0, 1.0)
    pairs = [found[id(member.cameras)] for member in members]
    degrees = [np.degrees(np.arccos(cosines)) for _, cosines in pairs]
    return np.stack([best for best, _ in pairs], axis=1), np.max(degrees, axis=0)


def _axes(cameras: Sequence[Camera]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.array([c.forward for c in cameras]).reshape(-1, 3), np.array([c.up for c in cameras]).reshape(-1, 3)
