"""Rendering beside a running simulation: a field comes in, its pictures stay, the field may go.

`render_member` is the hook for a loop; `Session` holds a catalog open over many members; `run_ensemble` spreads
members over processes.  What they are told with is here as well: parameters, appearances and their families, viewpoints.
Names load on first use, so importing this package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOMES = {
    "RenderedMember": "insitu.members.result",
    "Session": "insitu.hook.session",
    "render_member": "insitu.hook.session",
    "Field": "insitu.fields.field",
    "EnsembleResult": "insitu.ensembles.ensemble",
    "run_ensemble": "insitu.ensembles.ensemble",
    "probe_fields": "insitu.ensembles.probe",
    "make_dataset": "insitu.ensembles.dataset",
    # What a loop says of its ensemble: parameters, appearances, viewpoints.
    "Parameter": "catalogs.vocabulary.parameters",
    "ParameterSpace": "catalogs.vocabulary.parameters",
    "Quantity": "catalogs.vocabulary.quantity",
    "TransferFunction": "catalogs.vocabulary.appearance",
    "VolumeRendering": "catalogs.vocabulary.appearance",
    "Isosurface": "catalogs.vocabulary.appearance",
    "field_variation": "catalogs.vocabulary.variations",
    "isovalue_family": "catalogs.vocabulary.variations",
    "transfer_function_family": "catalogs.vocabulary.variations",
    "ViewPlan": "catalogs.vocabulary.scene",
    "Catalog": "catalogs.store.catalog",
    "CatalogError": "catalogs.store.plan",
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
