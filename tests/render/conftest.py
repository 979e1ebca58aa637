"""Fields and transfer functions with known difficulties, for every renderer's tests."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.appearance import TransferFunction
from render.datasets import to_grid
from render.grids import Grid

RAINBOW = ((-1.0, 0.1, 0.2, 0.9), (-0.2, 0.2, 0.8, 0.8), (0.3, 0.9, 0.9, 0.1), (1.0, 0.9, 0.1, 0.0))


@pytest.fixture(scope="session")
def gyroid() -> Grid:
    """A gyroid of amplitude 1 (24 x 28 x 32 samples, spacings 1 : 1.2 : 0.8), off the origin."""
    z, y, x = np.mgrid[0:32, 0:28, 0:24] * np.array([0.08, 0.12, 0.1]).reshape(3, 1, 1, 1)
    a, b, c = 2.2 * x, 2.0 * y, 2.4 * z
    field = (np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a)) / 1.5
    return to_grid(field, spacing=(0.1, 0.12, 0.08), origin=(-3.0, 5.0, 1.0))


@pytest.fixture(scope="session")
def smooth() -> TransferFunction:
    """Opacity that grows with the value."""
    return TransferFunction(RAINBOW, ((-1.0, 0.0), (0.0, 0.1), (1.0, 0.8)), 0.4)


@pytest.fixture(scope="session")
def peaks() -> TransferFunction:
    """Two narrow peaks, and values beyond the control points on both sides."""
    points = ((-0.5, 0.02), (-0.35, 0.02), (-0.3, 0.9), (-0.25, 0.02), (0.4, 0.02), (0.44, 0.95), (0.48, 0.05))
    return TransferFunction(RAINBOW[1:3], points, 0.3)
