"""Deformable Gaussians fitted to a Cinema catalog: any view, any parameter, in milliseconds."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "Surrogate": "model",
    "look_at": "model",
    "TrainingSettings": "settings",
    "train": "training.run",
    "render": "splatting",
    "show": "explore.server.notebook",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("catalogs.version").version()
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
