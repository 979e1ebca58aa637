"""A field to hook, how it looks, and the files that it leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catalogs.vocabulary.appearance import TransferFunction

FUNCTION = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.2, 0.0), (1.0, 0.6)), 0.3)


SPACING = (0.1, 0.1, 0.1)


def blob(width: float = 0.5, size: int = 12) -> np.ndarray:
    """A Gaussian blob around the middle of the grid, (z, y, x)."""
    grid = np.meshgrid(*[np.linspace(-1.0, 1.0, size)] * 3, indexing="ij")
    return np.exp(-sum(g**2 for g in grid) / (2 * width**2)).astype(np.float32)


def tree(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("[!.]*") if p.is_file()}
