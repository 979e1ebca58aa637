"""Comparisons of tensors and of drawn pictures."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.training.data import Example


def stored_picture(gaussians: Gaussians, camera: Camera, parameters: Tensor) -> Example:
    """The view of Gaussians by `camera`, as a stored image of those `parameters` (P,)."""
    with torch.no_grad():
        drawn = Rasterizer().draw(gaussians, camera)
    rgba = torch.cat([drawn.color, drawn.alpha[..., None]], dim=2).numpy().clip(0, 1)
    rgba[..., :3] = np.minimum(rgba[..., :3], rgba[..., 3:])
    return Example(camera, parameters, np.round(255.0 * rgba).astype(np.uint8))


def same(a: Gaussians, b: Gaussians) -> bool:
    """True if all numbers are equal."""
    return all(torch.equal(x, y) for x, y in zip(a.tensors().values(), b.tensors().values(), strict=True))
