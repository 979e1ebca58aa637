"""Fields that were dear to compute, kept on disk between the pilot run that sets the plan and their rendering."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class KeptField:
    """A field read back: `values` (z, y, x), `spacing`, `origin` (x, y, z) in world units, simulation `time`."""

    values: NDArray[np.float32]  # [nz, ny, nx]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]
    time: float | None


def keep_field(folder: Path, name: str, identity: Mapping[str, Any], field: Any) -> None:
    """Store `field` (with values, spacing, origin and, maybe, time) as `name`; `identity` says what made it."""
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f".{name}.{os.getpid()}.partial.npz"
    time = getattr(field, "time", None)
    try:
        np.savez(
            partial,
            values=field.values,
            spacing=field.spacing,
            origin=field.origin,
            time=np.nan if time is None else time,
            identity=json.dumps(identity, sort_keys=True),
        )
        partial.replace(_path(folder, name))
    finally:
        partial.unlink(missing_ok=True)


def kept_field(folder: Path, name: str, identity: Mapping[str, Any]) -> KeptField | None:
    """The field stored as `name` by the same `identity`, or None: absent, made otherwise or not readable."""
    try:
        with np.load(_path(folder, name), allow_pickle=False) as stored:
            if str(stored["identity"]) != json.dumps(identity, sort_keys=True):
                return None
            spacing, origin = tuple(stored["spacing"].tolist()), tuple(stored["origin"].tolist())
            time = float(stored["time"])
            return KeptField(stored["values"], spacing, origin, None if np.isnan(time) else time)
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def drop_field(folder: Path, name: str) -> None:
    """Forget the field stored as `name`, and the folder when it was the last."""
    _path(folder, name).unlink(missing_ok=True)
    with suppress(OSError):  # not empty yet, or already gone
        folder.rmdir()


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name}.npz"
