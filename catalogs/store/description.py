"""`catalog.json`, which makes a folder a catalog: what a table can't hold, and the schema that says who can read it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from catalogs.files import cinema, durable
from catalogs.store.plan import CatalogError, CatalogPlan, read_json
from catalogs.store.table import HIDDEN, MEMBERS, TABLE

SCHEMA = 5  # 1 had no variations, and every member all appearances; 2 no fields; 3 no logarithmic scales; 4 no packs
WITHOUT_FIELDS = 2
WITHOUT_SCALES = 3
WITHOUT_PACKS = 4
DESCRIPTION = "catalog.json"
LOCK = ".lock"


def write_empty(path: Path, plan: CatalogPlan) -> None:
    """Make the locked folder `path` a catalog without members; its description is written last: then all is there."""
    table = cinema.format_rows([plan.header]).encode()
    _refuse_foreign(path, table)
    durable.remove_abandoned(path)
    durable.make_folder(path / MEMBERS)
    durable.replace(path / TABLE, table)
    write_description(path, {"schema": _least_schema(plan), **plan.to_json()})


def _least_schema(plan: CatalogPlan) -> int:
    """The first schema whose readers understand the plan: older programs read what has no fields, scales or packs."""
    if plan.packed:
        return SCHEMA
    if plan.space.logarithmic:
        return WITHOUT_PACKS
    fields = any(plan.fields) or not all(variation.continuous for variation in plan.variations)
    return WITHOUT_SCALES if fields else WITHOUT_FIELDS


def allow_fewer_appearances(path: Path) -> None:
    """Raise schema 1, whose readers expect every appearance of every member, to the next one."""
    record = read_json(path / DESCRIPTION)
    if record["schema"] < WITHOUT_FIELDS:
        write_description(path, {**record, "schema": WITHOUT_FIELDS})


def write_description(path: Path, record: Mapping[str, Any]) -> None:
    durable.replace(path / DESCRIPTION, json.dumps(record, indent=1, allow_nan=False).encode())


def _refuse_foreign(path: Path, table: bytes) -> None:
    """Raise CatalogError where the folder holds more than an interrupted `create` of the same `table` leaves."""
    ours = {LOCK, MEMBERS, *HIDDEN, *(partial.name for partial in durable.partials(path))}
    foreign = {entry.name for entry in path.iterdir()} - ours
    if TABLE in foreign and (path / TABLE).read_bytes() == table:
        foreign.remove(TABLE)
    if foreign:
        raise CatalogError(f"{path} holds other things ({', '.join(sorted(foreign)[:3])}): choose another path")
