"""Repair of a damaged catalog: rows and table are rebuilt, members that must be rendered again are set aside.

    x.cdb/damaged/<name>     a member that was set aside; <name>.2 and so on if there are several

Nothing is deleted.  A member is set aside if its record, its images or its summary are damaged.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.members import RECORD
from catalogs.store.missing import report_missing
from catalogs.store.plan import name_problem, read_json
from catalogs.store.table import MEMBERS
from catalogs.tools.check import Finding, Progress, check
from catalogs.tools.damage import lasting_problems
from catalogs.vocabulary.words import shortened

DAMAGED = "damaged"


@dataclass(frozen=True)
class SetAside:
    """A member that was set aside: its new path, its problems, and its parameters, empty where its record is damaged."""

    name: str
    path: Path
    problems: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        values = "".join(f" {name}={value:g}" for name, value in self.parameters.items()) or " of unknown parameters"
        return f"member {self.name}{values}: moved to {self.path}: {shortened(self.problems, 1)}"


@dataclass(frozen=True)
class Repaired:
    """Members that `repair` set aside, and remaining problems."""

    set_aside: tuple[SetAside, ...]
    findings: tuple[Finding, ...]


def repair(path: Path, *, progress: Progress = lambda done, total: None) -> Repaired:
    """Check the catalog at `path`, set members aside that must be rendered again, rebuild rows and table, and check again.

    Other findings remain, such as two members of equal parameters.  Killed at any moment, it leaves a catalog whose table names
    existing files only; running it again completes it.

    Raises CatalogError, before anything is written, where there is no catalog or its description is damaged.
    """
    catalog = Catalog.open(path)
    suspects = dict.fromkeys(finding.member for finding in check(path, progress=progress) if finding.member)
    moved: list[SetAside] = []

    def set_aside() -> dict[str, Path]:
        """The suspects that are still damaged, under the catalog's lock."""
        for name in suspects:
            folder = path / MEMBERS / name
            problems = tuple(lasting_problems(catalog, folder)) if folder.exists() or folder.is_symlink() else ()
            if problems:
                moved.append(SetAside(name, _free(path / DAMAGED / name), problems, _parameters(catalog, folder)))
        return {member.name: member.path for member in moved}

    catalog.repair(set_aside)
    for member in moved:
        reason = f"it was damaged, and set aside as {member.path.relative_to(path)}: {member.problems[0]}"
        with suppress(OSError):
            report_missing(path, member.name, member.parameters, reason)
    return Repaired(tuple(moved), tuple(check(path, decode=False)))


def how_to_render_again(catalog: Catalog, members: Iterable[SetAside]) -> str:
    """A sentence on rendering the members again that were set aside."""
    provenance = catalog.plan.provenance
    if catalog.plan.packed:
        return f"Run `catalogs pack` again from the original of {catalog.path}: it packs the missing members"
    if "scene" in provenance:
        command = f"`insitu dataset` with the file of the scene {provenance['scene']!r}"
    elif "source" in provenance:
        command = "the `insitu ensemble` or `insitu watch` command that made this catalog"
    else:
        command = 'the program that made this catalog, with existing="skip" where it calls `render_member`,'
    names = shortened([member.name for member in members])
    return f"To make {names} again, run {command}: it renders the missing members only"


def _free(path: Path) -> Path:
    candidates = (path.with_name(f"{path.name}.{number}") for number in count(2))
    return path if not path.exists() else next(place for place in candidates if not place.exists())


def _parameters(catalog: Catalog, folder: Path) -> dict[str, float]:
    """The parameters in the member's record; empty where it is damaged."""
    try:
        stored: dict[str, Any] = read_json(folder / RECORD)["parameters"]
        values = {name: float(stored[name]) for name in catalog.plan.space.names}
    except (CatalogError, OSError, KeyError, TypeError, ValueError):
        return {}
    return values if all(map(math.isfinite, values.values())) and name_problem(folder.name) is None else {}
