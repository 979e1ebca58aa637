"""Members that are in the catalog already: an error, skipped, or replaced."""

from __future__ import annotations

from dataclasses import replace

from catalogs.store.catalog import Catalog
from catalogs.store.plan import CatalogError
from insitu.members.request import TIMES, Existing, MemberRequest


def stored_name(catalog: Catalog, request: MemberRequest, existing: Existing) -> str | None:
    """The stored member that stands for the request and is skipped; None where it is to be rendered.

    Raises CatalogError where it must not be: another member has its name, or, unless `existing` allows, its parameters.
    """
    same = catalog.find(request.parameters)
    if existing == "skip" and same is not None:
        return same
    if existing == "replace" and request.named and same not in (None, request.name):
        raise CatalogError(
            f"member {same} of {catalog.path} has these parameters, and can't be replaced by {request.name}: leave name out, "
            f"or pass name={same!r}"
        )
    if existing == "error" and same is not None:
        raise CatalogError(_duplicate(catalog, request, same))
    if existing != "replace" and request.name in catalog:
        parameters = dict(catalog.member(request.name).parameters)
        raise CatalogError(
            f"member {request.name} is in {catalog.path} already, with other parameters, {parameters}: nothing was written for "
            f"{dict(request.parameters)}; give it another name"
        )
    return None


def under_stored_name(catalog: Catalog, request: MemberRequest) -> MemberRequest:
    """The request, called as the stored member that it replaces."""
    same = catalog.find(request.parameters)
    return request if same is None else replace(request, name=same)


def _duplicate(catalog: Catalog, request: MemberRequest, same: str) -> str:
    rerun = 'If this is a rerun, pass existing="skip" or existing="replace".'
    space = catalog.plan.space
    if any(name in space.names for name in TIMES):
        dump = ""
    else:
        bounds = "".join(f'"{p.name}": ({p.text(p.low)}, {p.text(p.high)}), ' for p in space.parameters)
        dump = (
            " If it is another time of the same run, make time a parameter of a new catalog, "
            f'space={{{bounds}"time": (first, last)}}, and pass time= with every dump.'
        )
    return (
        f"member {same} with parameters {dict(request.parameters)} is in {catalog.path} already: nothing was written for "
        f"{request.name}. {rerun}{dump}"
    )
