"""Members that should be in a catalog but could not be made: a small file each, beside the members.

    x.cdb/.missing/<name>.json     its parameters, why it is missing, and when that was found

Whoever renders the member later removes the file.  Nothing depends on these files, so they need no lock.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catalogs.files import durable
from catalogs.store.plan import CatalogError, name_problem, read_json

MISSING = ".missing"
LONGEST_REASON = 2000  # characters


@dataclass(frozen=True)
class MissingMember:
    """A member that was reported missing: its name, its parameters as far as they were numbers, why, and when (UTC)."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""
    when: str = ""

    def __str__(self) -> str:
        return f"{self.name}: {self.reason.splitlines()[0] if self.reason else 'for no reason that was told'}"


def report_missing(catalog: Path, name: str, parameters: Any, reason: str) -> None:
    """Record in the catalog at this path that a member is missing; raises OSError where the disk refuses."""
    if name_problem(name):
        return  # no member could be called so
    folder = catalog / MISSING
    folder.mkdir(exist_ok=True)
    known = parameters if isinstance(parameters, Mapping) else {}
    numbers = {str(key): float(value) for key, value in known.items() if isinstance(value, int | float)}
    record = {
        "parameters": {key: value for key, value in numbers.items() if math.isfinite(value)},
        "reason": reason[:LONGEST_REASON],
        "when": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    durable.replace(folder / f"{name}.json", json.dumps(record, indent=1).encode())


def no_longer_missing(catalog: Path, name: str) -> None:
    """Remove what `report_missing` recorded of a member."""
    with suppress(OSError):
        (catalog / MISSING / f"{name}.json").unlink(missing_ok=True)


def missing_members(catalog: Path) -> tuple[MissingMember, ...]:
    """What was reported missing and is not there, sorted by name; damaged records are left out."""
    found = []
    for path in sorted((catalog / MISSING).glob("[!.]*.json")):
        with suppress(CatalogError, OSError, ValueError, TypeError):
            record = read_json(path)
            parameters = {str(key): float(value) for key, value in dict(record.get("parameters", {})).items()}
            found.append(
                MissingMember(path.stem, parameters, str(record.get("reason", "")), str(record.get("when", "")))
            )
    return tuple(member for member in found if not (catalog / "members" / member.name / "member.json").is_file())
