"""Fields that were expensive to compute, stored between the pilot run that sets the plan and their rendering."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.summary import DAMAGED
from insitu.field import Field

ALONE = ""  # the name of a field that is not one of several


def save_field(folder: Path, name: str, identity: Mapping[str, Any], field: Any) -> None:
    """Store `field` as `name`; `identity` says what made it.

    It has values, spacing, origin and, maybe, time; several are a mapping by their names.
    """
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f".{name}.{os.getpid()}.partial.npz"
    held = field if isinstance(field, Mapping) else {ALONE: field}
    arrays = {
        f"{number}/{key}": value for number, one in enumerate(held.values()) for key, value in _arrays(one).items()
    }
    try:
        np.savez(
            partial, names=np.array(list(held), dtype=np.str_), identity=json.dumps(identity, sort_keys=True), **arrays
        )
        partial.replace(_path(folder, name))
    finally:
        partial.unlink(missing_ok=True)


def load_field(folder: Path, name: str, identity: Mapping[str, Any]) -> Field | dict[str, Field] | None:
    """The field, or the fields by name, stored as `name` by the same `identity`; None: absent, made otherwise or not readable."""
    try:
        with np.load(_path(folder, name), allow_pickle=False) as stored:
            if str(stored["identity"]) != json.dumps(identity, sort_keys=True):
                return None
            found = {str(known): _read(stored, f"{number}/") for number, known in enumerate(stored["names"])}
            return found.get(ALONE, found)
    except DAMAGED:
        return None


def _arrays(field: Any) -> dict[str, Any]:
    time = getattr(field, "time", None)
    return {
        "values": field.values,
        "spacing": field.spacing,
        "origin": field.origin,
        "time": np.nan if time is None else time,
    }


def _read(stored: Mapping[str, Any], prefix: str) -> Field:
    spacing, origin = tuple(stored[f"{prefix}spacing"].tolist()), tuple(stored[f"{prefix}origin"].tolist())
    time = float(stored[f"{prefix}time"])
    return Field(stored[f"{prefix}values"], spacing, origin, time=None if np.isnan(time) else time)


def drop_field(folder: Path, name: str) -> None:
    """Forget the field stored as `name`, and the folder when it was the last."""
    _path(folder, name).unlink(missing_ok=True)
    with suppress(OSError):  # not empty yet, or already gone
        folder.rmdir()


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name}.npz"
