"""Members that could not be made: a small file each, beside the members.

    x.cdb/.missing/<name>.json     parameters, reason and time

Rendering the member later removes the file.  Nothing depends on these files, so they need no lock.
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
    """A member that was reported missing: its name, its parameters as far as they were numbers, the reason, and the time (UTC)."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""
    when: str = ""

    def __str__(self) -> str:
        return f"{self.name}: {self.reason.splitlines()[0] if self.reason else 'no reason recorded'}"


def report_missing(catalog: Path, name: str, parameters: Any, reason: str) -> None:
    """Record that a member of the catalog at this path is missing; raises OSError where the disk refuses."""
    if name_problem(name):
        return
    folder = catalog / MISSING
    folder.mkdir(exist_ok=True)
    values = parameters.items() if isinstance(parameters, Mapping) else ()
    numbers = {str(key): float(value) for key, value in values if isinstance(value, int | float)}
    record = {
        "parameters": {key: value for key, value in numbers.items() if math.isfinite(value)},
        "reason": reason[:LONGEST_REASON],
        "when": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    durable.replace(folder / f"{name}.json", json.dumps(record, indent=1).encode())


def no_longer_missing(catalog: Path, name: str, parameters: Mapping[str, float] | None = None) -> None:
    """Remove the files that `report_missing` wrote for a member: that of its name, and those of its parameters."""
    if not (catalog / MISSING).is_dir():
        return
    same = [m.name for m in missing_members(catalog) if parameters and m.parameters == parameters]
    with suppress(OSError):
        for missing in (name, *same):
            (catalog / MISSING / f"{missing}.json").unlink(missing_ok=True)


def missing_members(catalog: Path) -> tuple[MissingMember, ...]:
    """Members that were reported missing and are still absent, sorted by name; damaged records are left out."""
    reported = []
    for path in sorted((catalog / MISSING).glob("[!.]*.json")):
        with suppress(CatalogError, OSError, KeyError, ValueError, TypeError, AttributeError):
            record = read_json(path)
            parameters = {str(key): float(value) for key, value in record["parameters"].items()}
            reported.append(MissingMember(path.stem, parameters, str(record["reason"]), str(record["when"])))
    return tuple(member for member in reported if not (catalog / "members" / member.name / "member.json").is_file())
