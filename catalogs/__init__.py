"""The vocabulary and the store: cameras, appearances, parameter spaces, scenes, Cinema databases."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "Camera": "cameras",
    "icosphere": "cameras",
    "orbit": "cameras",
    "TransferFunction": "appearance",
    "VolumeRendering": "appearance",
    "Isosurface": "appearance",
    "ImportedImages": "appearance",
    "Parameter": "parameters",
    "ParameterSpace": "parameters",
    "Scene": "scene",
    "Catalog": "catalog",
    "CatalogPlan": "catalog",
    "CatalogError": "catalog",
    "Member": "catalog",
    "FieldSummary": "summary",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
