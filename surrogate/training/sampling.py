"""The order of training images: all equally often."""

from __future__ import annotations

import numpy as np

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
