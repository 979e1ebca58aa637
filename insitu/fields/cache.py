"""Fields that were expensive to compute, stored between the pilot run that sets the plan and their rendering."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catalogs.store.summary import DAMAGED
from insitu.fields.field import Field
from insitu.fields.member_fields import Fields, time_of

if TYPE_CHECKING:
    from render.grids import Grid

ALONE = ""  # the name of a field that is not one of several


def save_field(folder: Path, name: str, identity: Mapping[str, Any], field: Any) -> None:
    """Store `field` as `name`; `identity` says what made it.

    It has values, spacing, origin and, maybe, time; several are a mapping by their names.  Samples of `Fields` without a value
    are stored as NaN.
    """
    if isinstance(field, Fields):
        field = {label: _with_holes(grid) for label, grid in field.grids.items()}
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f".{name}.{os.getpid()}.partial.npz"
    by_name = field if isinstance(field, Mapping) else {ALONE: field}
    about = [
        {"name": label, "spacing": _numbers(f.spacing), "origin": _numbers(f.origin), "time": time_of(f)}
        for label, f in by_name.items()
    ]
    record = json.dumps({"identity": identity, "fields": about})
    try:
        np.savez(partial, record=record, **{str(number): f.values for number, f in enumerate(by_name.values())})
        partial.replace(_path(folder, name))
    finally:
        partial.unlink(missing_ok=True)


def load_field(folder: Path, name: str, identity: Mapping[str, Any]) -> Field | dict[str, Field] | None:
    """The field, or fields by name, stored as `name` with this `identity`; None where absent, made otherwise or unreadable."""
    try:
        with np.load(_path(folder, name), allow_pickle=False) as archive:
            record = json.loads(str(archive["record"]))
            if record["identity"] != json.loads(json.dumps(identity)):
                return None
            by_name = {
                about["name"]: Field(
                    archive[str(number)], tuple(about["spacing"]), tuple(about["origin"]), time=about["time"]
                )
                for number, about in enumerate(record["fields"])
            }
            return by_name.get(ALONE, by_name)
    except DAMAGED:
        return None


def _with_holes(grid: Grid) -> Field:
    """The grid's samples, NaN where it has holes."""
    values = grid.values
    if grid.holes is not None:
        wide = values if values.dtype.kind == "f" else values.astype(np.float64)
        values = np.where(grid.holes, wide.dtype.type(np.nan), wide)
    return Field(values, grid.spacing, grid.origin)


def _numbers(values: Any) -> list[float]:
    return [float(value) for value in values]


def drop_field(folder: Path, name: str) -> None:
    """Delete the field stored as `name`, and the folder with the last one."""
    _path(folder, name).unlink(missing_ok=True)
    with suppress(OSError):  # not empty yet, or already gone
        folder.rmdir()


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name}.npz"
