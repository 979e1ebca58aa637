"""Rendering beside a running simulation: a field comes in, its pictures stay, the field may go.

`render_member` is the hook for a loop; `Session` holds a catalog open over many members; `run_ensemble` spreads
members over processes.  What they are told with is here as well: parameters, appearances and their families, viewpoints.
Names load on first use, so importing this package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOMES = {
    "RenderedMember": "insitu.rendered",
    "Session": "insitu.hook",
    "render_member": "insitu.hook",
    "Field": "insitu.field",
    "EnsembleResult": "insitu.ensemble",
    "run_ensemble": "insitu.ensemble",
    "probe_fields": "insitu.probe",
    "make_dataset": "insitu.dataset",
    # What a loop says of its ensemble: parameters, appearances, viewpoints.
    "Parameter": "catalogs.parameters",
    "ParameterSpace": "catalogs.parameters",
    "Quantity": "catalogs.quantity",
    "TransferFunction": "catalogs.appearance",
    "VolumeRendering": "catalogs.appearance",
    "Isosurface": "catalogs.appearance",
    "field_variation": "catalogs.variations",
    "isovalue_family": "catalogs.variations",
    "transfer_function_family": "catalogs.variations",
    "ViewPlan": "catalogs.scene",
    "Catalog": "catalogs.catalog",
    "CatalogError": "catalogs.plan",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("catalogs.version").version()
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
