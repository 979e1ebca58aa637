"""Which image each training step learns from: all equally often, or those with large errors more often."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.randomness import generator


class ShuffledEpochs:
    """All of `count` items in a random order, then in another one, and so on; the item of any step can be asked for."""

    def __init__(self, count: int, seed: int) -> None:
        if count < 1:
            raise ValueError(f"there must be at least one image to train on, got {count}")
        self._count, self._seed = count, seed
        self._epoch, self._order = -1, np.empty(0, dtype=np.int64)

    def __getitem__(self, step: int) -> int:
        epoch, place = divmod(step, self._count)
        if epoch != self._epoch:
            self._epoch, self._order = epoch, generator(self._seed, "order", epoch).permutation(self._count)
        return int(self._order[place])


HARD_BLOCK = 100  # steps for which the chances of the images stay the same
MEMORY = 0.5  # of an image's running error, when it is seen again
LEAST_CHANCE = 0.1  # of the mean: an image without an error is seen that often, or nobody would know when it gets one


class HardExamples:
    """Items drawn in proportion to a power of their running errors, in blocks; one that was never seen counts as the worst.

    The easiest are still drawn about a tenth as often as they would be without regard to errors.  A block is drawn
    systematically (one random offset, evenly spaced quantiles), so that its mixture is as near to the chances as can be.
    The `errors` (count,) and the present `block` (HARD_BLOCK,) are all the state.
    """

    def __init__(self, count: int, seed: int, power: float) -> None:
        if count < 1 or not power > 0:
            raise ValueError(f"hard examples need images and a positive power, got {count} images and {power}")
        self._seed, self._power = seed, power
        self.errors = np.full(count, np.nan)  # [count]
        self.block = np.zeros(HARD_BLOCK, dtype=np.int64)

    def __getitem__(self, step: int) -> int:
        number, place = divmod(step, HARD_BLOCK)
        if place == 0:
            self.block[:] = self._drawn(number)
        return int(self.block[place])

    def tell(self, item: int, error: float) -> None:
        """Take note of the error of an item's picture."""
        before = self.errors[item]
        self.errors[item] = error if np.isnan(before) else MEMORY * before + (1.0 - MEMORY) * error

    def tensors(self) -> dict[str, Tensor]:
        """The state by name; writing to it changes the state."""
        return {"hard.errors": torch.from_numpy(self.errors), "hard.block": torch.from_numpy(self.block)}

    def _drawn(self, number: int) -> NDArray[np.int64]:
        random = generator(self._seed, "hard examples", number)
        worst = np.nanmax(self.errors) if not np.isnan(self.errors).all() else 1.0
        errors = np.maximum(np.where(np.isnan(self.errors), worst, self.errors), 0.0)  # [count]
        chances = (errors / (errors.max() or 1.0)) ** self._power  # [count]
        chances = np.maximum(chances, LEAST_CHANCE * chances.mean() or 1.0)
        cumulative = np.cumsum(chances)  # [count]
        quantiles = (np.arange(HARD_BLOCK) + random.random()) / HARD_BLOCK * cumulative[-1]  # [HARD_BLOCK]
        drawn = np.searchsorted(cumulative, quantiles, side="right").clip(max=len(chances) - 1)
        return random.permutation(drawn)
