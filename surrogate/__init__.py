"""The surrogate: Gaussians fitted to a catalog's images, deformed by the ensemble's parameters."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "DeformedGaussians": "surrogate.model",
    "Surrogate": "surrogate.model",
    "TrainingProgress": "surrogate.progress",
    "TrainingSettings": "surrogate.settings",
    "train": "surrogate.training",
}

__all__ = ["DeformedGaussians", "Surrogate", "TrainingProgress", "TrainingSettings", "train"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'surrogate' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
