"""Trivial predictors: weighted sums of stored images at the same view."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from surrogate.evaluation.cases import Case
from surrogate.evaluation.predictor import Draw
from surrogate.evaluation.trivial.interpolation import Rule

SAME_VIEW_DEGREES = 0.5


class Sources(Protocol):
    """The stored images that may be mixed to predict a case, and their points in parameter space."""

    def stored(self, case: Case) -> Sequence[tuple[Member, str, int]]:
        """Member, appearance and view of M images; empty where the case can't be predicted."""

    def points(self, case: Case) -> NDArray[np.float64]:
        """Points of these images in parameter space, (M, P)."""

    def place(self, case: Case) -> NDArray[np.float64]:
        """Point of the case in parameter space, (P,)."""


@dataclass(frozen=True, eq=False)
class Mixtures:
    """Predicts images as weighted sums of stored ones, with weights by rule."""

    catalog: Catalog
    sources: Sources
    rules: Mapping[str, Rule]

    @property
    def names(self) -> list[str]:
        """See `Predictor`."""
        return list(self.rules)

    def batches(self, cases: Sequence[Case]) -> Iterator[tuple[Sequence[Case], Draw]]:
        """See `Predictor`; the cases of a batch mix the same images, and no others are in memory."""
        batches: dict[tuple[tuple[str, str, int], ...], list[Case]] = {}
        for case in cases:
            key = tuple((member.name, appearance, view) for member, appearance, view in self.sources.stored(case))
            batches.setdefault(key, []).append(case)
        for batch in (batches[key] for key in batches if key):
            stored, points = self.sources.stored(batch[0]), self.sources.points(batch[0])
            wanted = np.array([self.sources.place(case) for case in batch])  # [T, P]
            weights = np.stack([rule(points, wanted) for rule in self.rules.values()], axis=1)  # [T, K, M]
            used = np.flatnonzero(weights.any(axis=(0, 1))).tolist()
            with ThreadPoolExecutor(2) as pool:
                loaded = pool.map(lambda i, s=stored: self.catalog.image(*s[i], dtype="float32"), used)
                pictures = np.stack(list(loaded))  # [U, H, W, 4]
            rows = dict(zip(batch, weights[:, :, used].astype(np.float32), strict=True))
            yield batch, partial(_mixed, rows, pictures)


def _mixed(rows: Mapping[Case, NDArray[np.float32]], pictures: NDArray[np.float32], case: Case) -> NDArray[np.float32]:
    """Images (K, H, W, 4) for a case's weights (K, U)."""
    mixed = rows[case] @ pictures.reshape(len(pictures), -1)  # [K, H * W * 4]
    return np.clip(mixed, 0.0, 1.0).reshape(-1, *pictures.shape[1:])


@dataclass(frozen=True, eq=False)
class MemberPictures:
    """Images of training members for unseen parameters, in all of their views, including those that the surrogate never saw.

    A missing view is replaced by the member's nearest one by viewing direction.
    """

    space: ParameterSpace
    appearance: str
    members: Sequence[Member] = field(repr=False)

    def stored(self, case: Case) -> list[tuple[Member, str, int]]:
        """See `Sources`."""
        nearest = self._nearest(case.camera)
        return [(member, self.appearance, nearest[id(member.cameras)][0]) for member in self.members]

    def points(self, _: Case) -> NDArray[np.float64]:
        """See `Sources`: normalized parameters."""
        return np.array([self._place(member) for member in self.members])

    def place(self, case: Case) -> NDArray[np.float64]:
        """See `Sources`."""
        return self._place(case.member)

    def borrowed_degrees(self, cases: Sequence[Case]) -> float:
        """The largest angle in degrees between a view and its replacement; 0 where every member has all views."""
        worst = max(degrees for case in cases for _, degrees in self._nearest(case.camera).values())
        return worst if worst > SAME_VIEW_DEGREES else 0.0

    def _place(self, member: Member) -> NDArray[np.float64]:
        return self.space.normalize([member.parameters[name] for name in self.space.names])

    @cached_property
    def _axes(self) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Viewing and upward directions (V, 3) by the identity of the cameras, which members share."""
        return {
            id(m.cameras): (np.array([c.forward for c in m.cameras]), np.array([c.up for c in m.cameras]))
            for m in {id(m.cameras): m for m in self.members}.values()
        }

    def _nearest(self, camera: Camera) -> dict[int, tuple[int, float]]:
        """The most similar view in each set of cameras, and the angle to it in degrees."""
        views = {}
        for key, (forwards, ups) in self._axes.items():
            cosines = forwards @ camera.forward  # [V]
            # Viewing directions alone do not determine the roll about the axis.
            view = int((cosines + 1e-3 * (ups @ camera.up)).argmax())
            views[key] = view, float(np.degrees(np.arccos(np.clip(cosines[view], -1.0, 1.0))))
        return views
