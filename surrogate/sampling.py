"""Which image each training step looks at.

Everything drawn at random during training comes from a counter-based generator keyed by (seed, purpose, step), so
that a resumed run draws exactly what an undisturbed one would have, and no generator state needs saving.
"""

from __future__ import annotations

import numpy as np

PURPOSES = ("initialization", "order", "relocation", "latents", "hull")


def generator(seed: int, purpose: str, step: int = 0) -> np.random.Generator:
    """An independent generator for each (seed, purpose, step); Philox, Salmon et al. 2011."""
    return np.random.Generator(np.random.Philox(key=[seed, PURPOSES.index(purpose)], counter=[0, 0, 0, step]))


class ShuffledEpochs:
    """Visits `count` items in a fresh random order, again and again; item of a step without history."""

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
