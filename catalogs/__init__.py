"""The vocabulary and the store: cameras, appearances, parameter spaces, scenes, Cinema databases."""

from __future__ import annotations

import importlib
from typing import Any

_NAMES = {
    "vocabulary.cameras": ("Camera", "icosphere", "orbit"),
    "vocabulary.appearance": ("TransferFunction", "VolumeRendering", "Isosurface", "ImportedImages"),
    "vocabulary.parameters": ("Parameter", "ParameterSpace"),
    "vocabulary.scene": ("Scene",),
    "store.catalog": ("Catalog", "CatalogPlan", "CatalogError", "Member"),
    "store.summary": ("FieldSummary",),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("catalogs.version").version()
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
