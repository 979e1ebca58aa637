"""The pictures of one member that Gaussians may be placed by, and the points that these or the hook tell."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.words import one_line
from surrogate.gaussians import Normalization

VISIBLE = 2  # of 255: rounding to 8 bits, on disk and from premultiplied, can't reach further


@dataclass(frozen=True, eq=False)
class StartPoints:
    """M sampled points: places in normalized coordinates (M, 3), and where known straight RGB (M, 3) and field values (M,)."""

    places: NDArray[np.float64]  # [M, 3]
    colors: NDArray[np.float64] | None  # [M, 3]
    values: NDArray[np.float64] | None = None  # [M]

    __repr__ = one_line


class Picture(NamedTuple):
    """A camera in normalized coordinates, and what it sees: premultiplied RGBA (H, W, 4)."""

    camera: Camera
    pixels: NDArray[np.uint8]  # [H, W, 4]

    def __repr__(self) -> str:
        return one_line(self)


def representative_member(catalog: Catalog, appearance: str) -> Member:
    """The central one of the training members that show an appearance; raises ValueError where there is none."""
    members = [m for m in catalog.members if m.split == "train" and appearance in m.appearances]
    if not members:
        raise ValueError(
            f"catalog {catalog.path} holds no training member that shows {appearance} for Gaussians to start on"
        )
    return central_member(members, catalog.plan.space)


def central_member(members: Sequence[Member], space: ParameterSpace) -> Member:
    """The member whose normalized parameters are nearest to the mean of all, the first by name of equals."""
    members = sorted(members, key=lambda member: member.name)
    places = np.array([space.normalize([m.parameters[n] for n in space.names]) for m in members])  # [M, P]
    distances = np.linalg.norm(places - places.mean(axis=0), axis=1)  # [M]
    return members[int(distances.round(9).argmin())]  # rounded: equals differ in the last digit


def training_pictures(catalog: Catalog, member: Member, appearance: str, normalization: Normalization) -> list[Picture]:
    """The pictures of `member` that are of split train, as views and as a member; opaque where the catalog has a background.

    Raises ValueError where it has none.
    """
    views = [view for view in range(len(member.cameras)) if member.row_split(view) == "train"]
    if not views:
        raise ValueError(
            f"member {member.name} of {catalog.path} has no training images for Gaussians to start on: "
            "at least one view of split train of a member of split train is needed"
        )
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        images = pool.map(lambda view: catalog.image(member, appearance, view), views)
        return [Picture(normalization.camera(member.cameras[v]), i) for v, i in zip(views, images, strict=True)]


def foreground(pixels: NDArray[np.uint8], background: Sequence[float] | None) -> NDArray[np.uint8]:
    """The foreground of a picture: premultiplied RGBA (H, W, 4), 0 where only its background is seen.

    Parameters
    ----------
    pixels : (H, W, 4) premultiplied RGBA.
    background : (3,) RGB that opaque pictures stand on; a pixel that differs from it counts in full.
    """
    if background is None:
        return pixels * (pixels[..., 3:] > VISIBLE)
    differences = np.abs(pixels[..., :3] - 255.0 * np.asarray(background))  # [H, W, 3]
    return pixels * (differences.max(-1, keepdims=True) > VISIBLE)


def straight_colors(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Straight RGB (M, 3) in [0, 1] of premultiplied RGBA summed over pixels (M, 4); the mean of all where alpha is 0."""
    total = sums.sum(0)  # [4]
    mean = total[:3] / total[3] if total[3] > 0 else np.full(3, 0.5)
    is_visible = sums[:, 3] > 0  # [M]
    return np.where(is_visible[:, None], sums[:, :3] / np.where(is_visible, sums[:, 3], 1.0)[:, None], mean)
