"""Trivial predictors: weighted sums of stored images at the same view."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from surrogate.evaluation.cases import Case
from surrogate.evaluation.pictures import Images
from surrogate.evaluation.predictor import Draw
from surrogate.evaluation.trivial.interpolation import Rule

SAME_VIEW_DEGREES = 0.5
MIXED_VALUES = 16 * 1024**2  # numbers of pictures that are mixed at once


class Sources(Protocol):
    """The stored images that may be mixed to predict a case, and their points in parameter space."""

    def key(self, case: Case) -> Hashable:
        """Equal for cases that are predicted from the same images."""

    def images_for(self, case: Case) -> Sequence[tuple[Member, str, int]]:
        """Member, appearance and view of M images; empty where the case can't be predicted."""

    def points(self, case: Case) -> NDArray[np.float64]:
        """Points of these images in parameter space, (M, P)."""

    def place(self, case: Case) -> NDArray[np.float64]:
        """Point of the case in parameter space, (P,)."""


@dataclass(frozen=True, eq=False)
class Mixtures:
    """Predicts images as weighted sums of stored ones, with weights by rule."""

    images: Images
    sources: Sources
    rules: Mapping[str, Rule]

    @property
    def names(self) -> list[str]:
        """See `Predictor`."""
        return list(self.rules)

    def batches(self, cases: Sequence[Case]) -> Iterator[tuple[Sequence[Case], Draw]]:
        """See `Predictor`; the cases of a batch mix the same images, and no others are in memory."""
        batches: dict[Hashable, list[Case]] = {}
        for case in cases:
            batches.setdefault(self.sources.key(case), []).append(case)
        weights_by_views: dict[tuple[bytes, bytes], NDArray[np.float64]] = {}  # most views show the same members
        for batch in batches.values():
            sources = self.sources.images_for(batch[0])
            if not sources:
                continue
            points = self.sources.points(batch[0])
            wanted = np.array([self.sources.place(case) for case in batch])  # [T, P]
            key = points.tobytes(), wanted.tobytes()
            if key not in weights_by_views:
                weights_by_views[key] = np.stack([rule(points, wanted) for rule in self.rules.values()], axis=1)
            weights = weights_by_views[key]  # [T, K, M]
            used = np.flatnonzero(weights.any(axis=(0, 1))).tolist()
            with ThreadPoolExecutor(2) as pool:
                loaded = pool.map(lambda i, s=sources: self.images.image(*s[i], dtype="float32"), used)
                pictures = np.stack(list(loaded))  # [U, H, W, 4]
            some = max(1, MIXED_VALUES // (len(self.rules) * pictures[0].size))
            for first in range(0, len(batch), some):
                part = batch[first : first + some]
                yield part, _mixed(part, weights[first : first + some, :, used].astype(np.float32), pictures)


def _mixed(cases: Sequence[Case], weights: NDArray[np.float32], pictures: NDArray[np.float32]) -> Draw:
    """The images (K, H, W, 4) of each case, from weights (T, K, U) of pictures (U, H, W, 4)."""
    mixed = weights.reshape(-1, len(pictures)) @ pictures.reshape(len(pictures), -1)  # [T * K, H * W * 4]
    np.clip(mixed, 0.0, 1.0, out=mixed)
    return dict(zip(cases, mixed.reshape(*weights.shape[:2], *pictures.shape[1:]), strict=True)).__getitem__


@dataclass(frozen=True, eq=False)
class MemberPictures:
    """Images of training members for unseen parameters, in all of their views, including those that the surrogate never saw.

    A missing view is replaced by the member's nearest one by viewing direction.
    """

    space: ParameterSpace
    appearance: str
    members: Sequence[Member] = field(repr=False)

    def key(self, case: Case) -> Hashable:
        """See `Sources`."""
        return tuple(view for view, _ in self._nearest(case.camera).values())

    def images_for(self, case: Case) -> list[tuple[Member, str, int]]:
        """See `Sources`."""
        nearest = self._nearest(case.camera)
        return [(member, self.appearance, nearest[id(member.cameras)][0]) for member in self.members]

    def points(self, _: Case) -> NDArray[np.float64]:
        """See `Sources`: normalized parameters."""
        return self._points

    def place(self, case: Case) -> NDArray[np.float64]:
        """See `Sources`."""
        return self._place(case.member)

    def borrowed_degrees(self, cases: Sequence[Case]) -> float:
        """The largest angle in degrees between a view and its replacement; 0 where every member has all views."""
        worst = max(degrees for case in cases for _, degrees in self._nearest(case.camera).values())
        return worst if worst > SAME_VIEW_DEGREES else 0.0

    @cached_property
    def _points(self) -> NDArray[np.float64]:  # [M, P]
        return np.array([self._place(member) for member in self.members])

    def _place(self, member: Member) -> NDArray[np.float64]:
        return self.space.normalize([member.parameters[name] for name in self.space.names])

    @cached_property
    def _axes(self) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Viewing and upward directions (V, 3) by the identity of the cameras, which members share."""
        return {
            id(m.cameras): (np.array([c.forward for c in m.cameras]), np.array([c.up for c in m.cameras]))
            for m in {id(m.cameras): m for m in self.members}.values()
        }

    @cached_property
    def _nearest_by_camera(self) -> dict[int, tuple[Camera, dict[int, tuple[int, float]]]]:
        """Cameras by their identity, each with its nearest views."""
        return {}

    def _nearest(self, camera: Camera) -> dict[int, tuple[int, float]]:
        """The most similar view in each set of cameras, and the angle to it in degrees."""
        if id(camera) not in self._nearest_by_camera:
            self._nearest_by_camera[id(camera)] = camera, self._nearest_views(camera)
        return self._nearest_by_camera[id(camera)][1]

    def _nearest_views(self, camera: Camera) -> dict[int, tuple[int, float]]:
        views = {}
        for key, (forwards, ups) in self._axes.items():
            cosines = forwards @ camera.forward  # [V]
            # Viewing directions alone do not determine the roll about the axis.
            view = int((cosines + 1e-3 * (ups @ camera.up)).argmax())
            views[key] = view, float(np.degrees(np.arccos(np.clip(cosines[view], -1.0, 1.0))))
        return views
