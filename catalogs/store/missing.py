"""Members that could not be made: a small file each, beside the members.

    x.cdb/.missing/<name>.json     parameters, reason and time

Rendering the member later removes the file.  Nothing depends on these files, so they need no lock.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catalogs.files import durable
from catalogs.files.digests import is_sealed, sealed
from catalogs.store.plan import CatalogError, name_problem, parsed_json, read_bytes

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
        "name": name,
        "parameters": {key: value for key, value in numbers.items() if math.isfinite(value)},
        "reason": reason[:LONGEST_REASON],
        "when": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    durable.replace(folder / f"{name}.json", sealed(record))


def no_longer_missing(catalog: Path, name: str, parameters: Mapping[str, float] | None = None) -> None:
    """Remove the files that `report_missing` wrote for a member: that of its name, and those of its parameters."""
    if not (catalog / MISSING).is_dir():
        return
    same = [m.name for m in missing_members(catalog) if parameters and m.parameters == parameters]
    with suppress(OSError):
        for missing in (name, *same):
            (catalog / MISSING / f"{missing}.json").unlink(missing_ok=True)


def missing_members(catalog: Path) -> tuple[MissingMember, ...]:
    """Members that were reported missing and are still absent, sorted by name; damaged reports are left out."""
    return tuple(member for _, member in reports(catalog) if member is not None)


def reports(catalog: Path) -> Iterator[tuple[str, MissingMember | None]]:
    """Names of absent members that were reported missing, sorted, and each report; None where it is damaged."""
    for path in sorted((catalog / MISSING).glob("[!.]*.json")):
        if (catalog / "members" / path.stem / "member.json").is_file():
            continue
        member = None
        with suppress(CatalogError, OSError, KeyError, ValueError, TypeError, AttributeError):
            data = read_bytes(path)
            record = parsed_json(path, data)
            if (is_sealed(data) or "digest" not in record) and record.get("name") in (None, path.stem):
                parameters = {str(key): float(value) for key, value in record["parameters"].items()}
                member = MissingMember(path.stem, parameters, str(record["reason"]), str(record["when"]))
        yield path.stem, member
