"""Repair of a damaged catalog: rows and table are rebuilt, members that must be rendered again are set aside.

    x.cdb/damaged/<name>     a member that was set aside; <name>.2 and so on if there are several

Nothing is deleted.  A member is set aside if its record, its images or the files of its fields are damaged.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

from catalogs.files import durable
from catalogs.files.digests import digest_of_file
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.description import DESCRIPTION, LOCK, accept_description
from catalogs.store.digests import Digests
from catalogs.store.members import (
    CAMERAS,
    FIELD_FILES,
    NO_DIGESTS,
    RECORD,
    ROWS,
    own_name,
    read_member,
    record_of,
    restored_record,
)
from catalogs.store.missing import report_missing
from catalogs.store.table import MEMBERS, TABLE, member_paths, parameters_in
from catalogs.tools.check import Finding, Progress, check
from catalogs.tools.damage import fields_problem, file_problem, images_of, lasting_problems
from catalogs.vocabulary.words import named_values, shortened

DAMAGED = "damaged"
Known = Mapping[str, Mapping[str, float]]  # parameters by member


@dataclass(frozen=True)
class SetAside:
    """A member that was set aside: its new path, its problems, and its parameters, empty where no undamaged file has them."""

    name: str
    path: Path
    problems: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        values = named_values(self.parameters) or "of unknown parameters"
        return f"member {self.name} {values}: moved to {self.path}: {shortened(self.problems, 1)}"


@dataclass(frozen=True)
class Repaired:
    """Members that `repair` set aside, remaining problems, and sentences on members that needed no rendering."""

    set_aside: tuple[SetAside, ...]
    findings: tuple[Finding, ...]
    mended: tuple[str, ...] = ()


def repair(path: Path, *, progress: Progress = lambda done, total: None) -> Repaired:
    """Check the catalog at `path`, set members aside that must be rendered again, rebuild rows and table, and check again.

    Renamed folders get their members' names back, and records their parameters, where a digest proves them.  Members whose
    folders are gone are reported missing, with the parameters in the table.  Other findings remain, such as two members of equal
    parameters.  Killed at any moment, it leaves a catalog whose table names existing files only; running it again completes it.

    Raises CatalogError, before anything is written, where there is no catalog, its description is damaged, or its members were
    written for another description.
    """
    catalog = Catalog.open(path)
    findings = check(path, progress=progress)
    if wrong := next((finding for finding in findings if finding.place == DESCRIPTION), None):
        raise CatalogError(f"{path}: {wrong}")
    mended = list(_renamed_back(catalog))
    suspects = dict.fromkeys(finding.member for finding in (check(path) if mended else findings) if finding.member)
    moved: list[SetAside] = []

    def set_aside() -> dict[str, Path]:
        """The suspects that are still damaged, under the catalog's lock."""
        table = parameters_in(path / TABLE, catalog.plan) if suspects else {}
        for name in suspects:
            folder = path / MEMBERS / name
            mended.extend(_restored(catalog, folder, table))
            problems = tuple(lasting_problems(catalog, folder)) if folder.exists() or folder.is_symlink() else ()
            if problems:
                values = _parameters(catalog, folder, table)
                moved.append(SetAside(name, _free(path / DAMAGED / name), problems, values))
        return {member.name: member.path for member in moved}

    catalog.repair(set_aside)
    for member in moved:
        reason = f"it was damaged, and set aside as {member.path.relative_to(path)}: {member.problems[0]}"
        with suppress(OSError):
            report_missing(path, member.name, member.parameters, reason)
    return Repaired(tuple(moved), tuple(check(path, decode=False)), tuple(mended))


def accept(path: Path, *, progress: Progress = lambda done, total: None) -> tuple[Finding, ...]:
    """Take the files of the catalog at `path` as they are, write digests and rows anew, and return the remaining problems.

    This accepts a description or a member's record that was edited on purpose, and adds digests to members from an earlier
    version.  Members with images that are missing or can't be decoded, or other malformed files, stay as they are.

    Raises CatalogError where there is no catalog, or its description is malformed.
    """
    with durable.locked(path / LOCK):
        accept_description(path)
    catalog = Catalog.open(path)
    folders = member_paths(path)
    for done, folder in enumerate(folders, start=1):
        with suppress(CatalogError, OSError):
            _accept_member(catalog, folder)
        progress(done, len(folders))
    with suppress(CatalogError):  # malformed members block the table; they are found below
        catalog.repair()
    return tuple(check(path))


def _accept_member(catalog: Catalog, folder: Path) -> None:
    """Replace the member's record by one with the digests of its present files, unless one of them is damaged."""
    member, old = read_member(folder, catalog.plan, verify=False)
    if fields_problem(member, catalog.plan, NO_DIGESTS):
        return
    if any(file_problem(catalog.path, *image) for image in images_of(catalog, member, NO_DIGESTS)):
        return
    names = [name for name, _ in images_of(catalog, member, NO_DIGESTS)]
    digests = [digest_of_file(catalog.path / name) for name in names]
    files = {name: digest_of_file(folder / name) for name in (*FIELD_FILES, CAMERAS) if (folder / name).exists()}
    if catalog.plan.packed:
        new = replace(old, files={**files, names[0].rpartition("/")[2]: digests[0]})
    else:
        views = len(member.cameras)
        images = {a: "".join(digests[i * views : (i + 1) * views]) for i, a in enumerate(member.appearances)}
        new = Digests(images, files)
    record = record_of(member, catalog.plan, new)
    if record != durable.read(folder / RECORD):
        durable.replace(folder / RECORD, record)


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


def _renamed_back(catalog: Catalog) -> Iterator[str]:
    """Give renamed folders of members their own names, where those are free or a folder's that was renamed itself."""
    folder = catalog.path / MEMBERS
    with durable.locked(catalog.path / LOCK):
        for name in [path.name for path in member_paths(catalog.path)]:
            while (own := own_name(folder / name)) not in ("", name):
                other = own_name(folder / own)
                if (folder / own).exists() and other in ("", own):
                    break
                try:
                    (durable.exchange if other else durable.rename)(folder / name, folder / own)
                except OSError:  # the file system can't exchange folders
                    break
                durable.sync(folder)
                yield f"member {own}: its folder was called {name}, and has its name back"


def _free(path: Path) -> Path:
    candidates = (path.with_name(f"{path.name}.{number}") for number in count(2))
    return path if not path.exists() else next(place for place in candidates if not place.exists())


def _restored(catalog: Catalog, folder: Path, table: Known) -> Iterator[str]:
    """Give a member's record its former parameters back, from the table or its rows, where they alone changed."""
    if own_name(folder):
        return
    for parameters in _stored_in_rows(catalog, folder, table):
        if data := restored_record(folder, parameters):
            durable.replace(folder / RECORD, data)
            yield f"member {folder.name}: {RECORD} has its parameters back, which its rows still held"
            return


def _parameters(catalog: Catalog, folder: Path, table: Known) -> Mapping[str, float]:
    """A damaged member's parameters: from its record where that is right, else from the `table`, or its rows."""
    with suppress(CatalogError, OSError):
        return read_member(folder, catalog.plan)[0].parameters
    return next(_stored_in_rows(catalog, folder, table), {})


def _stored_in_rows(catalog: Catalog, folder: Path, table: Known) -> Iterator[Mapping[str, float]]:
    """The member's parameters in the `table` and in its own file of rows."""
    for rows in (table, parameters_in(folder / ROWS, catalog.plan)):
        if folder.name in rows:
            yield rows[folder.name]
