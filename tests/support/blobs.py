"""An ensemble whose truth is known: Gaussians that move with one parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import Camera, icosphere
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer


@dataclass(frozen=True)
class Blobs:
    """An ensemble over `p` in [0, 1]: `count` blobs that drift, swell and fade; world = origin + unit * x."""

    count: int = 12
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    unit: float = 1.0
    size: int = 32

    @property
    def space(self) -> ParameterSpace:
        return ParameterSpace((Parameter("p", 0.0, 1.0),))

    @property
    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return tuple(o - self.unit for o in self.origin), tuple(o + self.unit for o in self.origin)

    def cameras(self, frequency: int = 1) -> tuple[Camera, ...]:
        center = np.array(self.origin)
        return tuple(
            Camera.look_at(
                center + 5.0 * self.unit * direction, center, vertical_fov_degrees=32, width=self.size, height=self.size
            )
            for direction in icosphere(frequency)
        )

    def gaussians(self, p: float) -> Gaussians:
        """The truth at p, in coordinates where the box is [-1, 1]."""
        random = np.random.default_rng(5)
        means = random.uniform(-0.6, 0.6, (self.count, 3)) + (p - 0.5) * random.uniform(-0.5, 0.5, (self.count, 3))
        log_scales = np.log(random.uniform(0.12, 0.25, (self.count, 3))) + (p - 0.5) * 0.6
        opacity_logits = random.uniform(0.0, 2.0, self.count) + (p - 0.5) * random.uniform(-1.0, 1.0, self.count)
        columns = (
            means,
            log_scales,
            random.normal(size=(self.count, 4)),
            opacity_logits,
            random.random((self.count, 3)),
        )
        return Gaussians(*(torch.from_numpy(column).to(torch.float32) for column in columns))

    def picture(self, p: float, camera: Camera) -> NDArray[np.float32]:
        """Premultiplied RGBA (H, W, 4), drawn by the reference; `camera` in world coordinates."""
        matrix = camera.world_to_camera.copy()
        matrix[:3, 3] = (camera.rotation @ np.array(self.origin) + matrix[:3, 3]) / self.unit
        near = Camera(matrix, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
        drawn = Rasterizer(backend="reference").draw(self.gaussians(p), near)
        return torch.cat([drawn.color, drawn.alpha[..., None]], dim=2).to(torch.float32).numpy().clip(0.0, 1.0)


def stored(
    path: Path,
    blobs: Blobs = Blobs(),
    *,
    members: Sequence[tuple[str, float]] = (("train", 0.0), ("train", 0.5), ("train", 1.0)),
    view_splits: Sequence[str] = ("train",) * 10 + ("validation", "test"),
    background: tuple[float, float, float] | None = None,
    blank: bool = False,
) -> Catalog:
    """An ensemble of blobs as a catalog: members (split, p), the first views of the icosphere, blank or on a background."""
    cameras = blobs.cameras()[: len(view_splits)]
    plan = CatalogPlan(
        space=blobs.space,
        appearances=(ImportedImages("drawn"),),
        cameras=cameras,
        view_splits=tuple(view_splits),
        bounds=blobs.bounds,
        background=background,
    )
    catalog = Catalog.create(path, plan)
    for i, (split, p) in enumerate(members):
        with catalog.begin_member(f"member-{i}", {"p": p}, split=split) as writer:
            for view, camera in enumerate(cameras):
                picture = np.zeros((blobs.size, blobs.size, 4), np.float32) if blank else blobs.picture(p, camera)
                if background is not None:
                    picture[..., :3] += (1.0 - picture[..., 3:]) * np.array(background, np.float32)
                    picture[..., 3] = 1.0
                writer.write_image("drawn", view, picture)
    return Catalog.open(path)
