"""Copies of catalogs with smaller images, which the compared methods can learn in minutes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.progress import Count, Rate
from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera

SIDE = 128  # pixels: the size in published comparisons that train on a whole ensemble


def reduced(catalog: Catalog, path: Path, progress: Any = lambda _: None) -> Catalog:
    """`catalog` if no side of its images exceeds `SIDE`, otherwise a copy of it at `path` with smaller images.

    Each new pixel is the mean of the area that it covers. A catalog whose splits a run has chosen is copied too, with
    these splits. Members that exist at `path` are skipped.
    """
    cameras = {(c.width, c.height): c for m in catalog.members for c in m.cameras}
    if catalog.splits is None and max(side for size in cameras for side in size) <= SIDE:
        return catalog
    plan = replace(catalog.plan, cameras=tuple(smaller(c) for c in catalog.plan.cameras))
    smaller_catalog = Catalog.create(path, plan)
    left = [member for member in catalog.members if member.name not in smaller_catalog]
    rate = Rate()
    rate(0)
    for number, member in enumerate(left):
        progress(Count("smaller images", number, len(left), rate(number), "members"))
        _write(catalog, member, smaller_catalog)
    return smaller_catalog


def smaller(camera: Camera) -> Camera:
    """The same view with at most `SIDE` pixels a side."""
    factor = min(1.0, SIDE / max(camera.width, camera.height))
    return camera.resized(max(1, round(factor * camera.width)), max(1, round(factor * camera.height)))


def area_means(pixels: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """Premultiplied pixels (H, W, 4) reduced to (height, width, 4): rounded means over the area of each new pixel."""
    down, across = _areas(pixels.shape[0], height), _areas(pixels.shape[1], width)
    means = np.einsum("ih,hwc->iwc", down, pixels.astype(np.float32), optimize=True)  # [height, W, 4]
    means = np.einsum("jw,iwc->ijc", across, means, optimize=True)  # [height, width, 4]
    return np.asarray(means.round().clip(0, 255), dtype=np.uint8)


@lru_cache(maxsize=8)
def _areas(before: int, after: int) -> NDArray[np.float32]:
    """Share of each of `before` pixels in each of `after` pixels that cover the same side, (after, before); rows sum to 1."""
    borders = np.linspace(0.0, before, after + 1)
    pixels = np.arange(before)
    overlap = np.minimum(borders[1:, None], pixels + 1) - np.maximum(borders[:-1, None], pixels)  # [after, before]
    overlap = overlap.clip(min=0.0)
    return np.asarray(overlap / overlap.sum(axis=1, keepdims=True), dtype=np.float32)


def _write(catalog: Catalog, member: Member, made: Catalog) -> None:
    own = None if catalog.plan.cameras else [smaller(camera) for camera in member.cameras]
    with made.begin_member(
        member.name,
        member.parameters,
        split=member.split,
        cameras=own,
        view_splits=None if own is None else member.view_splits,
        provenance=member.provenance,
        appearances=member.appearances,
        outside="allow",
    ) as writer:
        for appearance, view, pixels in _pictures(catalog, member):
            camera = made.plan.cameras[view] if own is None else own[view]
            writer.write_image(appearance, view, area_means(pixels, camera.width, camera.height))
        if summaries := member.summaries():
            writer.write_summaries(summaries)
        if fields := member.coarse_fields():
            writer.write_coarse_fields(fields)


def _pictures(catalog: Catalog, member: Member) -> Iterator[tuple[str, int, NDArray[np.uint8]]]:
    for appearance in member.appearances:
        for view, pixels in enumerate(catalog.images(member, appearance)):
            yield appearance, view, pixels
