"""Ensembles of fields that functions of two parameters define."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

SHAPE, SPACING, ORIGIN = (8, 10, 12), (0.5, 0.25, 0.125), (-1.0, 2.0, 3.0)


def some_points(count: int, parameters: int = 2, seed: int = 0) -> NDArray[np.float64]:
    """Points (count, parameters) of a Latin hypercube, normalized."""
    return 2.0 * qmc.LatinHypercube(d=parameters, rng=np.random.default_rng(seed)).random(count) - 1.0


def places() -> NDArray[np.float64]:
    """World coordinates (Z, Y, X, 3) of the samples."""
    k, j, i = np.meshgrid(*map(np.arange, SHAPE), indexing="ij")
    return np.stack([i, j, k], -1) * np.array(SPACING) + np.array(ORIGIN)


def smooth(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Fields (M, Z, Y, X) that vary smoothly with the first two parameters."""
    x, y, z = np.moveaxis((places() - np.array(ORIGIN)) / (np.array(SPACING) * np.array(SHAPE[::-1])), -1, 0)
    first, second = points[:, 0, None, None, None], points[:, 1 % points.shape[1], None, None, None]
    return (10.0 + np.exp(0.5 * first) * np.sin(3.0 * x + second) + 0.3 * first * y * z).astype(np.float32)
