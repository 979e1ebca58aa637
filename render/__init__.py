"""A field, an appearance and cameras in; pictures out (VTK, off screen)."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_EXPORTS = {
    "Grid": "render.grids",
    "to_grid": "render.datasets",
    "render_views": "render.views",
    "SampleDistance": "render.quality",
    "choose_sample_distance": "render.quality",
}

__all__ = ["Grid", "SampleDistance", "choose_sample_distance", "render_views", "to_grid"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("catalogs.version").version()
    if name in _EXPORTS:
        return getattr(import_module(_EXPORTS[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
