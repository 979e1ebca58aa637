"""Variations of a base appearance by visualization parameters, which can be set freely in the explorer.

Isovalues vary over a family of isosurfaces beside the base, transfer functions by displacements of their two inner control points,
fields over a few appearances that replace the base.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations.field import APPEARANCE, FieldVariation, field_variation
from catalogs.vocabulary.variations.isovalue import ISOVALUE, IsovalueVariation, isovalue_family
from catalogs.vocabulary.variations.transfer_function import (
    POINT_PARAMETERS,
    TransferFunctionVariation,
    displaced,
    origins_of,
    transfer_function_family,
)
from catalogs.vocabulary.variations.variation import Family, Variation, VariationSetting
from catalogs.vocabulary.words import joined_names

__all__ = [
    "APPEARANCE",
    "ISOVALUE",
    "KINDS",
    "POINT_PARAMETERS",
    "Family",
    "Variation",
    "VariationSetting",
    "displaced",
    "field_variation",
    "isovalue_family",
    "origins_of",
    "transfer_function_family",
    "variation_from_json",
    "variation_kind",
]

KINDS: dict[str, type[Variation]] = {
    form.kind: form for form in (IsovalueVariation, TransferFunctionVariation, FieldVariation)
}


def variation_kind(kind: Any) -> type[Variation]:
    """The class of a kind by its name in JSON and TOML; raises ValueError for an unknown one."""
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"the kind of a variation must be one of {joined_names(KINDS)}, got {kind!r}")
    return KINDS[kind]


def variation_from_json(record: Mapping[str, Any]) -> Variation:
    """The variation of a `Variation.to_json` record; raises KeyError or ValueError on a malformed one."""
    settings = tuple(VariationSetting(s["appearance"], tuple(s["values"]), s["split"]) for s in record["settings"])
    space = ParameterSpace.from_json(record["parameters"])
    return variation_kind(record["kind"])(record["base"], space, settings)
