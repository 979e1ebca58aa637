"""Reading and writing `catalog.json`, which makes a folder a catalog: its schema and its plan."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from catalogs.files import cinema, durable
from catalogs.files.digests import digest_of
from catalogs.store.plan import ACCEPT, CHANGED, CatalogError, CatalogPlan, read_json
from catalogs.store.table import HIDDEN, MEMBERS, TABLE

SCHEMA = 5
OLDEST = 2  # schema that can still be read: 2 to 4 are 5 without fields, logarithmic scales or packs
DESCRIPTION = "catalog.json"
LOCK = ".lock"
DIGEST = "digest"
PLAN = ("parameters", "appearances", "cameras", "view_splits", "bounds", "background", "image_format", "provenance")
OPTIONAL = ("variations", "layout", "fields")
RESTORE = "restore it from a copy, or from an empty catalog of the same scene"


def check_place(path: Path, plan: CatalogPlan | None) -> None:
    """Raise CatalogError where no catalog of this plan can be at `path`: another ending, or something else is there.

    Raises ValueError for a path that begins with `~`.
    """
    durable.require_expanded(path)
    if path.suffix != ".cdb":
        raise CatalogError(f"a Cinema database is a folder whose name ends with .cdb, got {path}")
    if path.is_dir() and plan is not None:
        _refuse_foreign(path, cinema.format_rows([plan.header]).encode())
    if path.exists() and not path.is_dir():
        raise CatalogError(f"{path} is a file, and a catalog is a folder: choose another path")


def write_empty(path: Path, plan: CatalogPlan) -> None:
    """Make the locked folder `path` a catalog without members; its description is written last."""
    table = cinema.format_rows([plan.header]).encode()
    _refuse_foreign(path, table)
    durable.remove_abandoned(path)
    durable.make_folder(path / MEMBERS)
    durable.replace(path / TABLE, table)
    _write(path, {"schema": SCHEMA, **plan.to_json()})


def read_description(path: Path) -> CatalogPlan:
    """Plan of the catalog at `path`; raises CatalogError where it is absent, damaged, or of a schema that is not read."""
    return _read(path, read_json(path / DESCRIPTION))


def accept_description(path: Path) -> None:
    """Take the catalog's description for right, whatever its digest; raises CatalogError as `read_description` otherwise."""
    record = read_json(path / DESCRIPTION)
    accepted = {key: value for key, value in record.items() if key != DIGEST}
    _ = _read(path, accepted)
    if record.get(DIGEST) != _digest(_parts(accepted)):
        _write(path, accepted)


def _write(path: Path, record: Mapping[str, Any]) -> None:
    text = json.dumps({**record, DIGEST: _digest(_parts(record))}, indent=1, allow_nan=False)
    durable.replace(path / DESCRIPTION, text.encode())


def _read(path: Path, record: Mapping[str, Any]) -> CatalogPlan:
    schema = record.get("schema")
    if type(schema) is not int or schema < 1:
        raise CatalogError(f"{path / DESCRIPTION} is damaged: its schema is {schema!r}")
    if schema > SCHEMA:
        raise CatalogError(f"{path} has schema {schema}, this program reads up to {SCHEMA}: use a newer gs-surrogate")
    if schema < OLDEST:
        raise CatalogError(f"{path} has schema {schema}, this program reads from {OLDEST} on: render it again")
    parts = _parts(record)
    try:
        plan = CatalogPlan.from_json(record, digest=_digest(parts, without=("provenance",)))
    except (KeyError, TypeError, ValueError) as error:
        reason = str(error) if isinstance(error, ValueError) else repr(error)
        raise CatalogError(f"{path / DESCRIPTION} is damaged: {reason}") from error
    if record.get(DIGEST) not in (None, _digest(parts)):
        raise CatalogError(f"{path / DESCRIPTION} is damaged: {CHANGED}: {RESTORE}; {ACCEPT}")
    return plan


def _parts(record: Mapping[str, Any]) -> dict[str, str]:
    """JSON of the plan in a description's record, by key: of the keys that are read, so that later ones may be added."""
    return {key: json.dumps(record[key], sort_keys=True) for key in sorted((*PLAN, *OPTIONAL)) if key in record}


def _digest(parts: Mapping[str, str], without: tuple[str, ...] = ()) -> str:
    """The digest of a plan, that of `digest_of_json`."""
    text = ", ".join(f'"{key}": {part}' for key, part in parts.items() if key not in without)
    return digest_of(f"{{{text}}}".encode())


def _refuse_foreign(path: Path, table: bytes) -> None:
    """Raise CatalogError where the folder holds anything but the remains of an interrupted `create` of the same `table`.

    Another process may be creating it, or have created it: files come and go, so they are listed once.
    """
    names = {entry.name for entry in path.iterdir()}
    foreign = {name for name in names - {LOCK, MEMBERS, *HIDDEN} if not durable.is_partial(name)}
    if DESCRIPTION in foreign:
        return
    if TABLE in foreign and (path / TABLE).read_bytes() == table:
        foreign.remove(TABLE)
    if foreign:
        raise CatalogError(f"{path} holds other files ({', '.join(sorted(foreign)[:3])}): choose another path")
