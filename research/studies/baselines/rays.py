"""Rays through pixels and their crossings of a box, for radiance fields."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines.method import TrainingImages


class Rays(NamedTuple):
    """R rays: `origins` and unit `directions`, both (R, 3)."""

    origins: Tensor  # [R, 3]
    directions: Tensor  # [R, 3]


class Batch(NamedTuple):
    """Pixels to learn from: their rays, premultiplied RGBA `pixels` (R, 4) in [0, 1], and `parameters` (R, P)."""

    rays: Rays
    pixels: Tensor  # [R, 4]
    parameters: Tensor  # [R, P]


class PixelSampler:
    """Samples pixels uniformly from all images; the rays of every camera are the exact ones through the pixels' centres."""

    def __init__(self, pictures: TrainingImages) -> None:
        self._pictures = pictures
        cameras = pictures.cameras
        self._rotations = _float32([c.rotation for c in cameras])  # [V, 3, 3]
        self._positions = _float32([c.position for c in cameras])  # [V, 3]
        self._intrinsics = _float32([[c.fx, c.fy, c.cx, c.cy] for c in cameras])  # [V, 4]

    def draw(self, count: int, random: torch.Generator) -> Batch:
        """`count` pixels, with replacement."""
        number, height, width = self._pictures.pixels.shape[:3]
        pictures = torch.randint(number, (count,), generator=random)  # [R]
        rows = torch.randint(height, (count,), generator=random)  # [R]
        columns = torch.randint(width, (count,), generator=random)  # [R]
        views = self._pictures.views[pictures]  # [R]
        pixels = self._pictures.pixels[pictures.numpy(), rows.numpy(), columns.numpy()]  # [R, 4]
        directions = self._directions(views, rows, columns)
        rays = Rays(self._positions[views], directions)
        return Batch(rays, torch.from_numpy(pixels).to(torch.float32) / 255.0, self._pictures.parameters[pictures])

    def _directions(self, views: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        focal_x, focal_y, center_x, center_y = self._intrinsics[views].unbind(1)  # [R]
        across = (columns + 0.5 - center_x) / focal_x
        down = (rows + 0.5 - center_y) / focal_y
        local = torch.stack([across, down, torch.ones_like(across)], dim=1)  # [R, 3]
        directions = torch.einsum("rij,ri->rj", self._rotations[views], local)  # [R, 3]
        return torch.nn.functional.normalize(directions, dim=1)


def all_rays(camera: Camera) -> Rays:
    """The rays of every pixel, row by row: (H W, 3) each."""
    origin, directions = camera.rays()
    flat = torch.from_numpy(directions.reshape(-1, 3)).to(torch.float32)  # [H W, 3]
    return Rays(torch.from_numpy(origin).to(torch.float32).expand_as(flat), flat)


def crossings(rays: Rays, box: Tensor) -> tuple[Tensor, Tensor]:
    """Distances (R,) at which rays enter and leave a box (2, 3), both in front of the origin; both 0 for a ray that misses it.

    Kay & Kajiya 1986, "Ray tracing complex scenes": between the farthest entry and the nearest exit of the three slabs.
    """
    tiny = torch.finfo(rays.directions.dtype).tiny
    safe = torch.where(rays.directions.abs() < tiny, torch.full_like(rays.directions, tiny), rays.directions)
    to_planes = (box[:, None] - rays.origins) / safe  # [2, R, 3]
    near = to_planes.amin(dim=0).amax(dim=1).clamp(min=0.0)  # [R]
    far = to_planes.amax(dim=0).amin(dim=1)  # [R]
    hits = far > near  # [R]
    return torch.where(hits, near, 0.0), torch.where(hits, far, 0.0)


def _float32(values: Sequence[object]) -> Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))
