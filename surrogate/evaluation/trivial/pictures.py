"""The training members' pictures at any view, and what the trivial predictors make of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.cameras import Camera
from catalogs.catalog import Catalog, Member
from surrogate.evaluation.trivial.interpolation import Weights

SAME_VIEW_DEGREES = 0.5


@dataclass(frozen=True, eq=False)
class Target:
    """A picture to be predicted."""

    member: Member
    view: int

    @property
    def camera(self) -> Camera:
        return self.member.cameras[self.view]


@dataclass(frozen=True, eq=False)
class Prediction:
    """What every predictor makes of one target: (K, H, W, 4) float32, and how far the borrowed view is, in degrees."""

    target: Target
    pictures: NDArray[np.float32]
    degrees: float


def predictions(
    catalog: Catalog, appearance: str, members: Sequence[Member], targets: Sequence[Target], weights: Sequence[Weights]
) -> Iterator[Prediction]:
    """Predict each of T `targets` from M training `members`, by each of K weight matrices (T, M).

    Targets are taken view by view, so that only M pictures are in memory.  Where a member lacks the target's view
    its nearest one, by viewing direction, stands in.
    """
    matched = [_nearest_views(members, target.camera) for target in targets]
    order = sorted(range(len(targets)), key=lambda t: (matched[t][0], t))
    current: tuple[int, ...] | None = None
    for t in order:
        views, degrees = matched[t]
        if views != current:
            with ThreadPoolExecutor(2) as pool:
                loaded = list(
                    pool.map(lambda pair: catalog.image(pair[0], appearance, pair[1]), zip(members, views, strict=True))
                )
            pictures = np.stack(loaded).reshape(len(members), -1).astype(np.float32) / 255.0  # [M, H * W * 4]
            shape, current = loaded[0].shape, views
        rows = np.stack([w[t] for w in weights]).astype(np.float32)  # [K, M]
        mixed = np.clip(rows @ pictures, 0.0, 1.0).reshape(len(weights), *shape)
        yield Prediction(targets[t], mixed, degrees)


def _nearest_views(members: Sequence[Member], camera: Camera) -> tuple[tuple[int, ...], float]:
    views, worst = [], 0.0
    seen: dict[int, tuple[int, float]] = {}
    for member in members:
        key = id(member.cameras)
        if key not in seen:
            cosines = np.array([float(c.forward @ camera.forward) for c in member.cameras])  # [V]
            # Directions alone don't tell a camera from the same one rolled about its axis.
            likeness = cosines + 1e-3 * np.array([float(c.up @ camera.up) for c in member.cameras])
            best = int(likeness.argmax())
            seen[key] = best, float(np.degrees(np.arccos(np.clip(cosines[best], -1.0, 1.0))))
        views.append(seen[key][0])
        worst = max(worst, seen[key][1])
    return tuple(views), worst
