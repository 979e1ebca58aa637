"""Smaller pictures to begin with: the mean of blocks of pixels, seen through the same camera.

What Gaussians must roughly be is learnt from small pictures as well, whose steps take less time.  While the rates of a stage fall
to 0, the pictures grow, twice as wide each time, and the last steps learn whole ones.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from surrogate.settings import MOST_DOWNSAMPLING
from surrogate.training.data import Example
from surrogate.training.stages import COOLDOWN

LEAST_SIDE = 128  # pixels that downsampling leaves


@dataclass(frozen=True)
class Downsampling:
    """Pictures are downsampled by a `factor` of 1, 2, 4 or 8 before the cooldown of a stage, which has `steps`."""

    factor: int
    steps: int

    def at(self, step: int) -> int:
        """The factor of a step."""
        late, halvings = (step / max(1, self.steps) - (1.0 - COOLDOWN)) / COOLDOWN, self.factor.bit_length() - 1
        return self.factor if late < 0.0 else self.factor >> min(halvings, 1 + int(late * halvings))


def shares(factor: int) -> list[tuple[int, float]]:
    """Each factor, from the first to 1, and its share of the steps of a stage."""
    halvings = factor.bit_length() - 1
    late = [(factor >> k, COOLDOWN / halvings) for k in range(1, halvings + 1)]
    return [(factor, 1.0 - COOLDOWN), *late] if late else [(1, 1.0)]


def downsampled(example: Example, factor: int) -> Example:
    """The same example with blocks of `factor` x `factor` pixels averaged; as it is where they don't fit its picture."""
    camera = example.camera
    if factor == 1 or camera.width % factor or camera.height % factor:
        return example
    smaller = camera.resized(camera.width // factor, camera.height // factor)
    return replace(example, camera=smaller, image=block_means(example.pixels, factor))


def block_means(pixels: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Rounded means of blocks of `factor` x `factor` pixels, 1, 2, 4 or 8: (H, W, C) to (H / factor, W / factor, C)."""
    height, width, channels = pixels.shape
    sums = np.zeros((height // factor, width, channels), np.uint16)
    for row in range(factor):
        sums += pixels[row::factor]
    blocks = np.full((height // factor, width // factor, channels), factor * factor // 2, np.uint16)
    for column in range(factor):
        blocks += sums[:, column::factor]
    return (blocks >> 2 * (factor.bit_length() - 1)).astype(np.uint8)  # by factor^2


def fitting_factor(cameras: Iterable[Camera]) -> int:
    """The largest power of two up to `MOST_DOWNSAMPLING` that divides all sides of pictures and leaves `LEAST_SIDE` pixels."""
    sides, factor = {side for camera in cameras for side in (camera.width, camera.height)}, 1
    while 2 * factor <= min(MOST_DOWNSAMPLING, min(sides) // LEAST_SIDE) and not any(s % (2 * factor) for s in sides):
        factor *= 2
    return factor
