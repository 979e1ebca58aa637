"""Handing a member over to the background: checked as far as that needs no look at its values, and copied once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from catalogs.store.catalog import Catalog
from catalogs.store.plan import CatalogError
from catalogs.vocabulary.appearance import Appearance
from insitu.background.process import Background
from insitu.fields.boxes import Box
from insitu.fields.field import Field
from insitu.fields.member_fields import LocalField
from insitu.members.agreement import notes_on_member
from insitu.members.conflicts import under_stored_name
from insitu.members.request import Existing, MemberArguments, MemberRequest
from insitu.members.result import RenderedMember


def queue_member(
    background: Background,
    field: LocalField,
    request: MemberRequest,
    existing: Existing,
    catalog: Catalog | None,
    all_appearances: Sequence[Appearance],
) -> RenderedMember:
    """Queue a member to be rendered; the result says "queued".

    `all_appearances` are those of the catalog.  With `existing="skip"` a member whose parameters are queued already is left to that
    one.  Raises as `Session.render_member` does, and CatalogError where a queued member has this name or these parameters.
    """
    if catalog is not None and existing == "replace":
        request = under_stored_name(catalog, request)
    waiting = background.holds(request.name, request.parameters)
    if waiting is not None and (existing != "skip" or waiting.parameters != request.parameters):
        raise CatalogError(
            f"member {waiting.name}, with parameters {dict(waiting.parameters)}, is queued already: nothing was done "
            f"for {request.name} with {dict(request.parameters)}"
        )
    if waiting is not None:
        return RenderedMember(waiting.name, background.catalog / "members" / waiting.name, queued=True)
    needed = (
        all_appearances if catalog is None else request.appearances
    )  # a new catalog's sample distances need all fields
    handed, box = handed_over(field, needed, all_appearances)
    if catalog is not None:
        notes_on_member(box, request.parameters, catalog.plan)  # raises where it does not fit; the renderer gives notes
    names = [appearance.name for appearance in request.appearances]
    arguments = MemberArguments(
        request.parameters, request.name, request.split, None, request.record, names, existing=existing
    )
    background.submit(arguments, handed)
    return RenderedMember(request.name, background.catalog / "members" / request.name, queued=True)


def handed_over(
    field: LocalField, appearances: Sequence[Appearance], all_appearances: Sequence[Appearance]
) -> tuple[LocalField, Box]:
    """The field as it is copied to the renderer, and the box that it fills.

    numpy arrays, a bundled `Field`, and mappings of these are copied as they are, after all checks that do not depend on their
    values.  Anything else (VTK and pyvista data sets, xarray's, arrays of other libraries or other axes) becomes a grid here,
    with the time and the memory that this takes.

    Raises as `LocalField.take` does; NaN and infinity in an array are found by the renderer alone.
    """
    data = field.loaded
    if field.location.dims is not None or not _are_plain(data):
        fields = LocalField(data, field.location).take(appearances, all_appearances)
        return LocalField(fields), fields.box
    stand_in = LocalField(_corner(data), field.location).take(appearances, all_appearances)
    grid = next(iter(stand_in.grids.values()))
    low, shape = np.array(grid.origin), np.array(_shapes(data)[0][::-1])
    x, y, z = map(float, low)
    right, back, top = map(float, low + np.array(grid.spacing) * (shape - 1))
    if isinstance(data, Mapping) and "" not in stand_in.grids:
        data = {name: data[name] for name in stand_in.grids}
    return LocalField(data, field.location), ((x, y, z), (right, back, top))


def _are_plain(data: Any) -> bool:
    several = data.values() if type(data) is dict else [data]
    arrays = [value.values if type(value) is Field else value for value in several]
    return bool(arrays) and all(type(value) is np.ndarray for value in arrays) and len(set(_shapes(data))) == 1


def _shapes(data: Any) -> list[tuple[int, ...]]:
    several = data.values() if type(data) is dict else [data]
    return [(value.values if type(value) is Field else value).shape for value in several]


def _corner(data: Any) -> Any:
    """Zeros of the same type and number of axes, but at most two along each."""
    if type(data) is dict:
        return {name: _corner(value) for name, value in data.items()}
    if type(data) is Field:
        return replace(data, values=_corner(data.values))
    return np.zeros([min(count, 2) for count in data.shape], data.dtype)
