"""The JSON schema of scene files, made from the code that reads them.

    python -m research.scene_schema        writes docs/reference/scene.schema.json

Keys, types, defaults and choices are those of the classes and functions that the tables become.  Editors with TOML support check
scenes by it as they are written; what depends on several keys at once, only the programs know.
"""

from __future__ import annotations

import inspect
import json
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, Literal

from catalogs.files import durable
from catalogs.vocabulary.appearance import KINDS, Isosurface, TransferFunction
from catalogs.vocabulary.parameters import SCALES, SPLITS, Parameter
from catalogs.vocabulary.scene import BACKENDS, CATALOG_TABLES, NAN, PLANNED, SOURCES, TABLES, RenderPlan, ViewPlan
from catalogs.vocabulary.variations import isovalue_family, transfer_function_family
from insitu.ensembles.sources import KEYS
from surrogate.settings import TrainingSettings

PATH = Path(__file__).resolve().parents[1] / "docs" / "reference" / "scene.schema.json"
OF_THE_SOURCE = {"path", "bounds", "background"}, {"path", "hold_out"}  # of the kinds nerf and catalog
NUMBER, TEXT = {"type": "number"}, {"type": "string"}
SIMPLE = {int: "integer", float: "number", str: "string", bool: "boolean"}
CHOICES = {(Parameter, "scale"): SCALES, (RenderPlan, "nan"): NAN, (RenderPlan, "backend"): BACKENDS}
Json = dict[str, Any]


def typed(hint: Any) -> Json:
    """The schema of a type of Python."""
    arguments = typing.get_args(hint)
    if hint in SIMPLE:
        return {"type": SIMPLE[hint]}
    if typing.get_origin(hint) is Literal:
        return {"enum": list(arguments)}
    if isinstance(hint, types.UnionType):
        return typed(next(each for each in arguments if each is not type(None)))
    if hint is TransferFunction:
        return of_class(TransferFunction)
    if isinstance(typing.get_origin(hint), type) and issubclass(typing.get_origin(hint), Mapping):
        return {"type": "object"}
    if isinstance(typing.get_origin(hint), type) and issubclass(typing.get_origin(hint), Sequence):
        counted = len(arguments) > 1 and ... not in arguments
        several = {"minItems": len(arguments), "maxItems": len(arguments)} if counted else {}
        return {"type": "array", "items": typed(arguments[0]), **several}
    raise TypeError(f"no schema is known for {hint}")


def table(properties: Mapping[str, Json], required: Sequence[str] = ()) -> Json:
    """A table of TOML with these keys alone."""
    needed = {"required": sorted(required)} if required else {}
    return {"type": "object", "properties": dict(properties), "additionalProperties": False, **needed}


def of_class(kind: Any, *, without: Sequence[str] = ()) -> Json:
    """The table that becomes an instance of a dataclass."""
    hints, properties, required = typing.get_type_hints(kind), {}, []
    for each in fields(kind):
        if each.name in without:
            continue
        choices = CHOICES.get((kind, each.name))
        properties[each.name] = {"enum": list(choices)} if choices else typed(hints[each.name])
        if each.default is MISSING:
            required.append(each.name)
        elif each.default not in (None, ""):
            properties[each.name]["default"] = each.default
    return table(properties, required)


def of_function(function: Callable[..., Any], *, without: Sequence[str] = ()) -> tuple[dict[str, Json], list[str]]:
    """Properties and required keys of the table that becomes a function's keyword-only arguments."""
    hints, properties, required = typing.get_type_hints(function), {}, []
    for name, argument in inspect.signature(function).parameters.items():
        if argument.kind is argument.KEYWORD_ONLY and name not in without:
            properties[name] = typed(hints[name])
            if argument.default is argument.empty:
                required.append(name)
    return properties, required


def kinds(forms: Mapping[str, Json]) -> Json:
    """A table whose `kind` is one of `forms`, and says which further keys it has."""
    return {
        "type": "object",
        "required": ["kind"],
        "oneOf": [
            {
                **form,
                "properties": {"kind": {"const": kind}, **form["properties"]},
                "required": ["kind", *form.get("required", ())],
            }
            for kind, form in forms.items()
        ],
    }


def sources() -> Json:
    """The `[source]` table."""
    images, catalog = OF_THE_SOURCE
    forms = {
        kind: table({key: {} for key in sorted(needed | more)}, sorted(needed)) for kind, (needed, more) in KEYS.items()
    }
    forms["loop"] = table({})
    forms["nerf"] = table({key: {} for key in sorted(images)}, ["path", "bounds"])
    forms["catalog"] = table({key: {} for key in sorted(catalog)}, ["path"])
    return kinds({kind: forms[kind] for kind in SOURCES})


def members() -> Json:
    """The `[members]` table: counts, or lists of values, lists and tables."""
    listed = {"type": ["integer", "array"]}
    return table({**dict.fromkeys(SPLITS, listed), "seed": {"type": "integer"}})


def variations() -> Json:
    """A `[[variation]]` table."""
    common = {"of": TEXT, "members": NUMBER, "compared": {"type": "integer"}}
    forms = {}
    for kind, function in (("isovalue", isovalue_family), ("transfer_function", transfer_function_family)):
        properties, required = of_function(function, without=["unit"])
        if "style" in properties:
            properties["style"] = of_class(Isosurface, without=["name", "isovalue"])
        forms[kind] = table({**common, **properties}, ["of", *required])
    names = {"type": ["array", "string"], "items": TEXT}
    forms["field"] = table({"of": TEXT, "appearances": names}, ["of", "appearances"])
    return kinds(forms)


def schema() -> Json:
    """The schema of a scene file."""
    listed = {
        "parameters": of_class(Parameter),
        "appearance": {"type": "object", "required": ["kind", "name"]},  # packages may add kinds
        "variation": variations(),
    }
    known = kinds({kind: of_class(form) for kind, form in KINDS.items()})["oneOf"]
    other = {"properties": {"kind": {"not": {"enum": list(KINDS)}}}}
    listed["appearance"]["oneOf"] = [*known, other]
    quantity = {"anyOf": [TEXT, table({"name": TEXT, "unit": TEXT})]}
    properties = {
        "name": TEXT,
        "title": TEXT,
        "source": sources(),
        "members": members(),
        "fields": {"type": "object", "additionalProperties": quantity},
        "views": of_class(ViewPlan),
        "render": of_class(RenderPlan),
        "training": of_class(TrainingSettings),
        **{name: {"type": "array", "items": form} for name, form in listed.items()},
    }
    assert set(properties) == TABLES
    whole = table({name: properties[name] for name in sorted(properties)}, ["name", "source"])
    of_catalog = {"properties": {"source": {"properties": {"kind": {"const": "catalog"}}}}}
    allowed = {"propertyNames": {"enum": sorted(CATALOG_TABLES)}}
    planned = {"properties": {"source": {"properties": {"kind": {"enum": list(PLANNED)}}}}}
    rules = [{"if": of_catalog, "then": allowed}, {"if": planned, "then": {"required": ["parameters", "members"]}}]
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Scene of gs-surrogate"}
    return {**head, **whole, "allOf": rules}


def text() -> str:
    """The contents of the file."""
    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    durable.replace(PATH, text().encode())
    print(PATH)
