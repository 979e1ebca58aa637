"""The way in which each appearance of a catalog is drawn, which its members share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.appearance import Appearance
from catalogs.vocabulary.words import shortened

if TYPE_CHECKING:
    from insitu.fields.member_fields import MemberFields


def backends_of(
    fields: MemberFields, appearances: Sequence[Appearance], wanted: str, usual: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Backends, "vtk" or "cpu", by the names of the appearances that they draw; others draw themselves.

    Raises ValueError where the backend that is `wanted` can't draw `fields`.
    """
    chosen = {a.name: fields.backend(a, wanted, (usual or {}).get(a.name, "")) for a in appearances}
    return {name: backend for name, backend in chosen.items() if backend}


def member_backends(
    fields: MemberFields, appearances: Sequence[Appearance], wanted: str, plan: CatalogPlan
) -> tuple[dict[str, str], list[str]]:
    """The backends of a member of a catalog, and notes on those that are not the catalog's."""
    recorded = plan.provenance.get("backends")
    usual = (
        dict.fromkeys((a.name for a in appearances), "vtk") if recorded is None else recorded
    )  # once there was VTK alone
    chosen = backends_of(fields, appearances, wanted, usual)
    others = sorted({backend for name, backend in chosen.items() if backend != usual.get(name)})
    names = [name for name, backend in chosen.items() if backend != usual.get(name)]
    note = (
        f"appearances {shortened(names)} are drawn by backend {' and '.join(others)}, where other members of the catalog were "
        "drawn by another; images of volumes agree to 80 dB, those of isosurfaces to 60 dB"
    )
    return chosen, [note] if names else []
