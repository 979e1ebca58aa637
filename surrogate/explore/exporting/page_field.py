"""The emulated field in a page: its modes as they are stored, and what shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from torch import Tensor

from catalogs.vocabulary.appearance import Appearance, Isosurface, VolumeRendering, appearance_to_json, field_of
from native.ray_casting.triangles import CASES
from native.ray_casting.volume import HEADLIGHT
from surrogate.emulation.storage import COARSE, FINE, OUTLINE
from surrogate.model import FieldModel, Surrogate
from surrogate.model.representation import FIELD, VIEW
from surrogate.notebook import first_camera
from surrogate.storage.encoding import Encoding
from surrogate.storage.models import StoredModel

UNCERTAINTY = ("residual", "errors")  # tensors that no picture needs
DRAWN = ("shape", "spacing", "origin", "groups", "scale", OUTLINE)  # of a field's record
SIDE = 48  # pixels of images that find distances along rays, as `fitting_distance` has them


def field_of_page(surrogate: Surrogate, modes: int | None) -> FieldModel | None:
    """The emulated field that a page of the surrogate holds; None without.

    It is there with a number of `modes`.  For None, it is there where it draws a kind of question best, or nothing else draws.
    """
    field = surrogate.field
    if field is None or modes == 0:
        return None
    if not all(isinstance(a, VolumeRendering | Isosurface) for a in _page_appearances(field).values()):
        return None
    kinds = (VIEW, *(v.kind for v in surrogate.variations))
    best = FIELD in {surrogate.representation(kind) for kind in kinds}
    return field if modes or best or not len(surrogate.gaussians) else None


def stored_field(field: FieldModel, modes: int | None) -> StoredModel:
    """The tensors of the fields with at most a number of modes each, and the record that draws them."""
    whole = field.emulators.stored_form()
    tensors: dict[str, Tensor] = {}
    encodings: dict[str, Encoding] = dict(whole.encodings)
    for name, tensor in whole.tensors.items():
        if name.rpartition(".")[2] not in UNCERTAINTY:
            tensors[name] = tensor
    groups = [record["groups"][:modes] for record in whole.record["fields"]]
    for number, own in enumerate(groups):
        left = len(own)
        for name in (f"{number}.{FINE}", f"{number}.{COARSE}"):
            count = min(left, tensors[name].shape[1])
            tensors[name] = tensors[name][:, :count].contiguous()
            encodings[name] = _first(encodings[name], count)
            left -= count
        coefficients = f"{number}.coefficients"
        tensors[coefficients] = tensors[coefficients][:, : len(own)].contiguous()
    records = [{k: record[k] for k in DRAWN if k in record} for record in whole.record["fields"]]
    fields = [record | {"groups": own} for record, own in zip(records, groups, strict=True)]
    return StoredModel(tensors, {"fields": fields, **_appearances(field)}, encodings)


def _first(encoding: Encoding, count: int) -> Encoding:
    """An encoded tensor (V, C) with its first columns alone."""
    assert encoding.low is not None
    assert encoding.step is not None
    codes = encoding.codes[:, :count].contiguous()
    return replace(encoding, codes=codes, low=encoding.low[:count], step=encoding.step[:count])


def _page_appearances(field: FieldModel) -> Mapping[str, Appearance]:
    """The appearances that a page may show: by name, "" for the isosurface of any isovalue."""
    appearances = {field.appearances[0].name: field.appearances[0]}
    for variation in field.variations:
        if variation.continuous and not variation.edits_base:
            appearances[""] = variation.appearance_at(variation.settings[0].values, field.appearances)
        elif not variation.continuous:
            appearances |= {a.name: a for a in field.appearances if variation.setting(a.name)}
    return appearances


def _appearances(field: FieldModel) -> dict[str, Any]:
    """All that draws the fields: appearances with the numbers of their fields, distances along rays, and constants."""
    numbers = {name: number for number, name in enumerate(field.emulators)}
    records = {
        name: appearance_to_json(a) | {"number": numbers[field_of(a)]} for name, a in _page_appearances(field).items()
    }
    surface, base = records.pop("", None), records[field.appearances[0].name]
    return {
        "base": base,
        "surface": surface,
        "named": records,
        "distances": {name: distance for name, distance in field.sample_distances.items() if name in records},
        "camera": first_camera(field.normalization, SIDE).to_json(),
        "cases": CASES,
        "headlight": HEADLIGHT,
    }
