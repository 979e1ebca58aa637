"""What can be mended of a damaged catalog is, and members that can't be are set aside, to be rendered again.

    x.cdb/damaged/<name>     a member that was set aside; <name>.2 and so on where that is there already

Nothing is deleted.  A member is set aside for what only rendering can bring back: its record, its pictures, its summary.  Rows and
table follow from the records, and are written anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
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
from catalogs.tools.check import Finding, check
from catalogs.tools.damage import lasting_problems
from catalogs.vocabulary.words import shortened

Progress = Callable[[int, int], None]
DAMAGED = "damaged"


@dataclass(frozen=True)
class SetAside:
    """A member that was set aside: where it is now, what was wrong with it, and its parameters, empty where they are not known."""

    name: str
    path: Path
    problems: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        values = "".join(f" {name}={value:g}" for name, value in self.parameters.items()) or " of unknown parameters"
        return f"member {self.name}{values}: moved to {self.path}: {shortened(self.problems, 1)}"


@dataclass(frozen=True)
class Repaired:
    """What `repair` has set aside, and what is wrong still."""

    set_aside: tuple[SetAside, ...]
    findings: tuple[Finding, ...]


def repair(path: Path, *, progress: Progress = lambda done, total: None) -> Repaired:
    """Check the catalog at `path` whole, set members aside that must be rendered again, write rows and table anew, and look again.

    Everything else that `check` finds is left as it is, such as two members of equal parameters: which is right nobody can tell.
    Killed at any moment, it leaves a catalog whose table names nothing that is not there; running it again completes it.

    Raises CatalogError where there is no catalog, or its description is damaged: nothing is written then.
    """
    catalog = Catalog.open(path)
    doubtful = dict.fromkeys(finding.member for finding in check(path, progress=progress) if finding.member)
    moved: list[SetAside] = []

    def set_aside() -> dict[str, Path]:
        """Of the members in doubt those that are damaged still, now that nobody writes."""
        for name in doubtful:
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
    """How members that were set aside are made again: a sentence."""
    told = catalog.plan.provenance
    if catalog.plan.packed:
        return f"Run `catalogs pack` from the catalog that was packed to {catalog.path} again: it packs the members that lack"
    if "scene" in told:
        command = f"`insitu dataset` with the file of the scene {told['scene']!r}"
    elif "source" in told:
        command = "the `insitu ensemble` or `insitu watch` command that made this catalog"
    else:
        command = 'the program that made this catalog, with existing="skip" where it calls `render_member`,'
    names = shortened([member.name for member in members])
    return f"To make {names} again, run {command}: it renders the members that are not there, and no others"


def _free(path: Path) -> Path:
    candidates = (path.with_name(f"{path.name}.{number}") for number in count(2))
    return path if not path.exists() else next(place for place in candidates if not place.exists())


def _parameters(catalog: Catalog, folder: Path) -> dict[str, float]:
    """What the member's record says of its parameters; empty where it is damaged."""
    try:
        stored: dict[str, Any] = read_json(folder / RECORD)["parameters"]
        values = {name: float(stored[name]) for name in catalog.plan.space.names}
    except (CatalogError, OSError, KeyError, TypeError, ValueError):
        return {}
    return values if all(map(math.isfinite, values.values())) and name_problem(folder.name) is None else {}
