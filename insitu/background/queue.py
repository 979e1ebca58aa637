"""A member that is asked for is handed over to the background."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from catalogs.store.catalog import Catalog
from catalogs.store.plan import CatalogError
from catalogs.vocabulary.appearance import Appearance
from insitu.background.handover import prepared
from insitu.background.process import Background
from insitu.members.agreement import notes_on_member
from insitu.members.conflicts import Existing, under_stored_name
from insitu.members.request import MemberRequest
from insitu.members.result import RenderedMember


def queue_member(
    background: Background,
    field: Any,
    request: MemberRequest,
    existing: Existing,
    catalog: Catalog | None,
    known: Sequence[Appearance],
    **place: Any,
) -> RenderedMember:
    """Hand a member over to be rendered, after all was checked that needs no look at its values; its result says "queued".

    `known` are the catalog's appearances.  With `existing="skip"` one whose parameters wait already is left to that.  Raises as
    `Session.render_member` does, and CatalogError where a member waits that has this name or these parameters.
    """
    if catalog is not None and existing == "replace":
        request = under_stored_name(catalog, request)
    waiting = background.holds(request.name, request.parameters)
    if waiting is not None and (existing != "skip" or waiting.parameters != request.parameters):
        raise CatalogError(
            f"member {waiting.name}, with parameters {dict(waiting.parameters)}, waits to be rendered already: nothing was done "
            f"for {request.name} with {dict(request.parameters)}"
        )
    result = RenderedMember(request.name, background.catalog / "members" / request.name, queued=True)
    if waiting is not None:
        return RenderedMember(waiting.name, result.path.with_name(waiting.name), queued=True)
    needed = known if catalog is None else request.shown  # a new catalog's sample distances need all fields
    data, left, box = prepared(field() if callable(field) else field, needed, known=known, **place)
    if catalog is not None:
        notes_on_member(
            box, request.parameters, catalog.plan
        )  # raises where it does not fit; the renderer gives the notes
    asked = {
        "split": request.split,
        "provenance": request.record,
        "appearances": [appearance.name for appearance in request.shown],
        "existing": existing,
        **left,
    }
    background.submit(request.name, request.parameters, data, asked)
    return result
