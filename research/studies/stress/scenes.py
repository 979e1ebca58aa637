"""Gaussians and cameras of the hard cases; float64, in numbers that float32 represents exactly."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from surrogate.splatting import Primitives

NEAR = 0.05
PIXEL = 0.0365  # approximate width of a pixel of `view()` at the origin, in world units


def view(width: int = 61, height: int = 47, *, eye: tuple[float, float, float] = (3.0, 0.6, 0.4)) -> Camera:
    """A camera that looks at the origin from `eye`."""
    return Camera.look_at(eye, (0.0, 0.0, 0.0), vertical_fov_degrees=35.0, width=width, height=height)


def off_center(width: int, height: int) -> Camera:
    """A camera with non-square pixels and a principal point far from the middle."""
    square = view(width, height)
    return Camera(square.world_to_camera, 0.8 * square.fx, 1.3 * square.fy, 0.2 * width, 0.9 * height, width, height)


def cloud(
    count: int = 60,
    *,
    seed: int = 3,
    scales: tuple[float, float] = (0.02, 0.08),
    opacities: tuple[float, float] = (0.02, 0.9),
    spread: float = 0.6,
) -> Primitives:
    """Random Gaussians in a cube of half-width `spread`, of any orientation and colour."""
    random = np.random.default_rng(seed)
    columns = (
        random.uniform(-spread, spread, (count, 3)),
        random.uniform(*scales, (count, 3)),
        random.normal(size=(count, 4)),
        random.uniform(*opacities, count),
        random.random((count, 3)),
    )
    return Primitives(*(torch.from_numpy(column) for column in columns))


def axes(ratio: float, thin: int, *, length: float = 0.3) -> Primitives:
    """A cloud of needles (two thin axes) or pancakes (one), whose axes have the ratio `ratio` to 1."""
    scales = torch.full((60, 3), length, dtype=torch.float64)
    scales[:, :thin] = length / ratio
    return cloud()._replace(scales=scales)


def radius(pixels: float) -> Primitives:
    """A cloud of round Gaussians with standard deviations of `pixels` pixels."""
    count = 60 if pixels >= 1.0 else 300  # few of the small ones cover the centre of a pixel
    return cloud(count, opacities=(0.02, 0.3))._replace(
        scales=torch.full((count, 3), pixels * PIXEL, dtype=torch.float64)
    )


def at_depths(depths: Tensor, *, size: float = 0.01) -> Primitives:
    """A Gaussian at each depth (N,) in front of `view()`, near its axis; sizes grow with the depth."""
    camera, some = view(), cloud(len(depths))
    spread = some.means * depths.abs()[:, None] * 0.1 * torch.tensor(1.0 - np.abs(camera.forward))  # [N, 3]
    means = torch.tensor(camera.position) + depths[:, None] * torch.tensor(camera.forward) + spread
    return some._replace(means=means, scales=some.scales * 0.0 + size * depths.abs()[:, None].clamp(min=1e-3))


def one_pixel(count: int, opacity: tuple[float, float]) -> Primitives:
    """`count` Gaussians, one behind the other, that cover about one pixel together."""
    crowd = cloud(count, seed=4, scales=(0.3 * PIXEL, 0.6 * PIXEL), opacities=opacity)
    along = torch.tensor(view().forward)
    return crowd._replace(
        means=crowd.means * 0.01 + torch.linspace(-0.8, 0.8, count, dtype=torch.float64)[:, None] * along
    )


def layers(count: int, opacity: float) -> Primitives:
    """`count` sheets that cover the whole frame evenly, all of the same opacity and colour."""
    even = cloud(count)
    along = torch.tensor(view().forward)
    return Primitives(
        torch.linspace(-0.8, 0.8, count, dtype=torch.float64)[:, None] * along,
        torch.full_like(even.scales, 1e5),
        even.quats,
        torch.full_like(even.opacities, opacity),
        torch.full_like(even.colors, 0.5),
    )


def tied(count: int) -> Primitives:
    """A cloud in which every second Gaussian coincides with the one before it."""
    some = cloud(count, scales=(0.01, 0.05))
    return some._replace(means=some.means[::2].repeat_interleave(2, dim=0)[:count])


def with_every_third(tensor: Tensor, first: float, second: float) -> Tensor:
    """A copy in which rows 0, 3, ... hold `first` and rows 1, 4, ... hold `second`."""
    changed = tensor.clone()
    changed[::3], changed[1::3] = first, second
    return changed


def with_lengths(quats: Tensor, *lengths: float) -> Tensor:
    """Quaternions (N, 4) of these lengths, in turn."""
    unit = quats / quats.norm(dim=1, keepdim=True)
    turn = torch.tensor(lengths, dtype=quats.dtype).repeat(len(quats) // len(lengths) + 1)[: len(quats)]
    return unit * turn[:, None]
