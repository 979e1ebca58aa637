"""Differences of a surrogate's pictures from given ones, as a function of what is not known: parameters, and poses of cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.answers.drafts import Draft, Drawn, Draws
from surrogate.answers.targets import Target
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.model import Surrogate
from surrogate.model.representation import GAUSSIANS, VIEW

TURN, SHIFT = 0.5, 0.25  # a camera moves by radians and by shares of its distance, where an unknown goes from 0 to 1
POSE = 6  # unknowns of a camera
AT_ONCE = 16  # points whose pictures are in memory together

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Residuals:
    """Differences of pictures from `targets`, over the pixels that count, at points (B, P + 6 U), which give (B, N).

    A point has P normalized parameters, then six numbers for each of U targets without a camera, which move the one in `cameras`.
    """

    surrogate: Surrogate
    targets: tuple[Target, ...]
    background: tuple[float, ...] | None
    cameras: tuple[Camera, ...]
    draws: Draws
    quick: Draft | None = None  # of the emulated field, where there is one
    views: tuple[Camera, ...] = ()  # among which those of targets without a camera are searched

    __repr__ = one_line

    @classmethod
    def of(
        cls,
        surrogate: Surrogate,
        targets: Sequence[Target],
        background: Sequence[float] | None,
        views: Sequence[Camera] = (),
    ) -> Residuals:
        """By the targets' own cameras, and for those without one by the first of the `views`.

        Raises ValueError for a target without a camera, where there are no views, or these have another shape.
        """
        behind, cameras = None if background is None else tuple(background), []
        for target in targets:
            if target.camera is None and not views:
                raise ValueError("a picture's camera is not known, and there are no views to search it among")
            view = target.camera or views[0]
            if target.width * view.height != target.height * view.width:
                raise ValueError(
                    f"a picture of {target.width} x {target.height} has another shape than the views, "
                    f"{view.width} x {view.height}: its camera can't be searched"
                )
            cameras.append(view.resized(target.width, target.height))
        quick = None if surrogate.field is None else Draft.of(surrogate.field)
        return cls(surrogate, tuple(targets), behind, tuple(cameras), Drawn(surrogate), quick, tuple(views))

    @property
    def parameters(self) -> int:
        """The number P of parameters."""
        return len(self.surrogate.space)

    @cached_property
    def unknowns(self) -> int:
        """The number of unknowns, P + 6 U."""
        return self.parameters + POSE * sum(target.camera is None for target in self.targets)

    def __call__(self, points: Array) -> Array:
        views = [self.seen_by(point) for point in points]  # [B][T]
        parts: list[Array] = [np.empty(0)] * len(self.targets)
        for size in dict.fromkeys(target.picture.shape for target in self.targets):
            mine = [i for i, target in enumerate(self.targets) if target.picture.shape == size]
            pictures = self.draws.pictures(points[:, : self.parameters], [[own[i] for i in mine] for own in views])
            displayed = composite(pictures, self.background or WHITE)  # [B, T, H, W, 3]
            for number, i in enumerate(mine):
                differences, mask = displayed[:, number] - self.targets[i].picture, self.targets[i].mask
                counting = differences if mask is None else differences[:, mask]
                parts[i] = counting.reshape(len(points), -1).astype(np.float64)
        return np.concatenate(parts, axis=1)

    def costs(self, points: Array) -> Array:
        """The mean squares (B,) of residuals."""
        return mean_squares(self, points)

    def costs_by_view(self, points: Array, side: int) -> Array:
        """Mean squares (B, V, T) of residuals by the views of targets without a camera, NaN for others."""
        costs = np.full((len(points), len(self.views), len(self.targets)), np.nan)
        draws = self.quick or self.draws  # drafts are exact enough, and show a field from many views fast
        for i, target in enumerate(self.targets):
            if target.camera is not None:
                continue
            small = target.resized(side)
            views = [view.resized(small.width, small.height) for view in self.views]
            for number, point in enumerate(points):
                displayed = composite(draws.pictures(point[None], [views])[0], self.background or WHITE)
                squares = (displayed - small.picture) ** 2
                counting = squares if small.mask is None else squares[:, small.mask]
                costs[number, :, i] = counting.reshape(len(views), -1).mean(1)
        return costs

    def seen_from(self, cameras: Mapping[int, Camera]) -> Residuals:
        """The same by other cameras of some targets, by number."""
        own = [cameras.get(i, camera) for i, camera in enumerate(self.cameras)]
        resized = (c.resized(t.width, t.height) for c, t in zip(own, self.targets, strict=True))
        return replace(self, cameras=tuple(resized))

    def seen_by(self, point: Array) -> tuple[Camera, ...]:
        """The cameras at a point (P + 6 U,)."""
        if self.unknowns == self.parameters:
            return self.cameras
        poses = iter(point[self.parameters :].reshape(-1, POSE))
        center = self.surrogate.normalization.center
        return tuple(
            moved(camera, next(poses), center) if target.camera is None else camera
            for camera, target in zip(self.cameras, self.targets, strict=True)
        )

    def at_most(self, side: int) -> Residuals:
        """The same of pictures with at most `side` pixels along their longer side."""
        targets = tuple(target.resized(side) for target in self.targets)
        cameras = tuple(c.resized(t.width, t.height) for c, t in zip(self.cameras, targets, strict=True))
        return replace(self, targets=targets, cameras=cameras)

    @cached_property
    def draft(self) -> Residuals | None:
        """The same by cheaper pictures, drafts of the emulated field; None where that is not drawn at all."""
        emulated = self.quick is not None and self.surrogate.representation(VIEW) != GAUSSIANS
        return replace(self, draws=self.quick) if emulated and self.quick is not None else None


def mean_squares(residuals: Callable[[Array], Array], points: Array) -> Array:
    """Means (B,) of squared residuals at points (B, U), some at once."""
    parts = [points[i : i + AT_ONCE] for i in range(0, len(points), AT_ONCE)]
    return np.concatenate([(residuals(part) ** 2).mean(1) for part in parts])


def moved(camera: Camera, pose: Array, center: Array) -> Camera:
    """The camera with the world turned about `center` (3,) before it, then shifted: `pose` (6,) in its own axes."""
    rotation, shift = camera.rotation, camera.world_to_camera[:3, 3]
    middle = rotation @ center + shift
    turn = Rotation.from_rotvec(TURN * pose[:3]).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ rotation
    distance = float(np.linalg.norm(middle))
    matrix[:3, 3] = turn @ (shift - middle) + middle + SHIFT * distance * pose[3:]
    return replace(camera, world_to_camera=matrix)


def angle_between(first: Camera, second: Camera) -> float:
    """The angle in radians by which one camera must turn to the other."""
    return float(Rotation.from_matrix(first.rotation @ second.rotation.T).magnitude())
