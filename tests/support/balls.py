"""An opaque ball whose pictures are known exactly, stored as a catalog."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import Camera, icosphere
from catalogs.vocabulary.parameters import Parameter, ParameterSpace

Texture = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # world points (N, 3) to straight RGB (N, 3)
SAMPLES = 3  # per pixel and direction


@dataclass(frozen=True)
class Ball:
    """A ball in world units, within the box `center` +- `half_box`; cameras look at the middle of the box."""

    radius: float = 60.0
    center: tuple[float, float, float] = (520.0, -290.0, 110.0)
    box_center: tuple[float, float, float] = (500.0, -300.0, 100.0)
    half_box: float = 100.0
    size: int = 64

    @property
    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return tuple(c - self.half_box for c in self.box_center), tuple(c + self.half_box for c in self.box_center)

    @property
    def normalized_center(self) -> NDArray[np.float64]:
        return (np.array(self.center) - self.box_center) / self.half_box

    @property
    def normalized_radius(self) -> float:
        return self.radius / self.half_box

    def cameras(self, frequency: int = 2) -> list[Camera]:
        center = np.array(self.box_center)
        return [
            Camera.look_at(
                center + 5.0 * self.half_box * direction,
                center,
                vertical_fov_degrees=32,
                width=self.size,
                height=self.size,
            )
            for direction in icosphere(frequency)
        ]

    def picture(self, camera: Camera, texture: Texture) -> NDArray[np.float32]:
        """Premultiplied RGBA (H, W, 4), the mean of `SAMPLES` x `SAMPLES` rays per pixel."""
        origin, directions = camera.resized(camera.width * SAMPLES, camera.height * SAMPLES).rays()
        towards = origin - np.array(self.center)  # [3]
        half = directions @ towards  # |towards + t direction|^2 = radius^2
        root = half**2 - towards @ towards + self.radius**2
        hit = root > 0
        distance = -half - np.sqrt(np.maximum(root, 0.0))
        fine = np.zeros((*hit.shape, 4))
        fine[hit, :3] = texture(origin + distance[hit][:, None] * directions[hit])
        fine[hit, 3] = 1.0
        return fine.reshape(camera.height, SAMPLES, camera.width, SAMPLES, 4).mean((1, 3)).astype(np.float32)


def grey(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """One straight colour everywhere."""
    return np.broadcast_to([0.25, 0.5, 0.75], points.shape)


@functools.cache
def speckled(ball: Ball, seed: int = 0) -> Texture:
    """Smooth noise of standard deviation 0.2 around mid-grey, with structure of about a 30th of the box."""
    noise = np.random.default_rng(seed).normal(size=(3, 96, 96, 96))
    smooth = np.stack([gaussian_filter(channel, 1.0, mode="wrap") for channel in noise])
    smooth = 0.5 + 0.2 * smooth / smooth.std()
    low, size = np.array(ball.bounds[0]), 2.0 * ball.half_box

    def texture(points: NDArray[np.float64]) -> NDArray[np.float64]:
        places = ((points - low) / size * 96).T  # [3, N]
        return np.stack([map_coordinates(c, places, order=1, mode="wrap") for c in smooth], axis=1).clip(0.0, 1.0)

    return texture


def store(
    folder: Path,
    ball: Ball,
    texture: Texture,
    *,
    cameras: Sequence[Camera] | None = None,
    members: Sequence[tuple[str, float]] = (("train", 0.0),),
    view_splits: Sequence[str] | None = None,
    background: tuple[float, float, float] | None = None,
    drawn: Callable[[Camera], NDArray[np.float32]] | None = None,
) -> Catalog:
    """The ball as a catalog of one parameter in [0, 1]; every member looks alike."""
    cameras = ball.cameras() if cameras is None else cameras
    plan = CatalogPlan(
        ParameterSpace((Parameter("p", 0.0, 1.0),)),
        (ImportedImages("drawn"),),
        tuple(cameras),
        ("train",) * len(cameras) if view_splits is None else tuple(view_splits),
        ball.bounds,
        background,
    )
    catalog = Catalog.create(folder / "ball.cdb", plan)
    pictures = [ball.picture(camera, texture) if drawn is None else drawn(camera) for camera in cameras]
    if background is not None:
        through = [1.0 - picture[..., 3:] for picture in pictures]
        rgb = [p[..., :3] + t * np.float32(background) for p, t in zip(pictures, through, strict=True)]
        pictures = [np.concatenate([c, np.ones_like(c[..., :1])], axis=2).astype(np.float32) for c in rgb]
    for i, (split, p) in enumerate(members):
        with catalog.begin_member(f"member-{i}", {"p": p}, split=split) as writer:
            for view, picture in enumerate(pictures):
                writer.write_image("drawn", view, picture)
    return catalog
