"""A field to hook, how it looks, and the files that it leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import insitu
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan

FUNCTION = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.2, 0.0), (1.0, 0.6)), 0.3)
VOLUME = VolumeRendering("dvr", FUNCTION)
SPACING = (0.1, 0.1, 0.1)


def blob(width: float = 0.5, size: int = 12) -> np.ndarray:
    """A Gaussian blob around the middle of the grid, (z, y, x)."""
    grid = np.meshgrid(*[np.linspace(-1.0, 1.0, size)] * 3, indexing="ij")
    return np.exp(-sum(g**2 for g in grid) / (2 * width**2)).astype(np.float32)


def tree(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("[!.]*") if p.is_file()}


def speed(width: float = 0.5) -> np.ndarray:
    """Another field than `blob`: a slope along x through a wider blob, up to 7."""
    return (8.0 * blob(0.8 * width) * np.linspace(0.2, 1.0, 12)[None, None, :]).astype(np.float32)


def render(path: Path, field: Any = None, reynolds: float = 150.0, **changes: Any) -> insitu.RenderedMember:
    """Hook a blob as member `Re`; `changes` are further or other arguments of `insitu.render_member`."""
    options: dict[str, Any] = {
        "space": {"Re": (100.0, 200.0)},
        "appearances": VOLUME,
        "views": ViewPlan(frequency=1, width=24, height=24),
        "spacing": SPACING,
        "sample_distance": 0.05,
    }
    options.update(changes)
    return insitu.render_member(blob() if field is None else field, {"Re": reynolds}, catalog=path, **options)
