"""Gaussians and cameras that splatting is tried with."""

from __future__ import annotations

import numpy as np
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate.splatting import Primitives


def view(width: int = 61, height: int = 47) -> Camera:
    """A camera that looks at the origin."""
    return Camera.look_at((3.0, 0.6, 0.4), (0.0, 0.0, 0.0), vertical_fov_degrees=35.0, width=width, height=height)


def off_center(width: int, height: int) -> Camera:
    """Pixels that are not square, and a principal point far from the middle."""
    square = view(width, height)
    return Camera(square.world_to_camera, 0.8 * square.fx, 1.3 * square.fy, 0.2 * width, 0.9 * height, width, height)


def cloud(count: int, opacities: tuple[float, float] = (0.02, 0.9)) -> Primitives:
    """Gaussians drawn evenly from a cube around the origin, turned any way; float64, in numbers that float32 holds."""
    random = np.random.default_rng(3)
    columns = (
        random.uniform(-0.6, 0.6, (count, 3)),
        random.uniform(0.02, 0.08, (count, 3)),
        random.normal(size=(count, 4)),
        random.uniform(*opacities, count),
        random.random((count, 3)),
    )
    return Primitives(*(torch.from_numpy(column).float().double() for column in columns))
