"""Random numbers keyed by (seed, purpose, step), independent of history.

A resumed run draws exactly the numbers of an uninterrupted one, and no generator state is saved. The generator is
numpy's counter-based Philox, behind one function so that two purposes never share a stream.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# A purpose's place is its key: those of former purposes stay, so that all others draw the same numbers.
PURPOSES = ("initialization", "order", "relocation", "latents", "hull", "hard examples", "normals", "values", "members")


def generator(seed: int, purpose: str, step: int = 0) -> np.random.Generator:
    """An independent generator for each (seed, purpose, step); Philox, Salmon et al. 2011."""
    return np.random.Generator(np.random.Philox(key=[seed, PURPOSES.index(purpose)], counter=[0, 0, 0, step]))


def sobol_points(count: int, dimensions: int, seed: int = 0) -> NDArray[np.float64]:
    """The first `count` points (N, P) of a scrambled Sobol sequence in [-1, 1]; Owen 1998."""
    from scipy.stats import qmc

    return np.asarray(2.0 * qmc.Sobol(dimensions, seed=np.random.default_rng(seed)).random(count) - 1.0)
