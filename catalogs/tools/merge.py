"""Several catalogs of one scene become one: what different machines, or runs that stopped, have rendered of an ensemble.

Everything is compared before anything is written.  Then members appear as a writer's do, whole or not at all, many in one commit;
what an interrupted merge has left out the same command adds.  Pictures are linked where the file system allows that, and take no
further space: nothing here ever changes a picture that is stored.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.files import durable
from catalogs.store.catalog import Catalog, CatalogError, CatalogPlan, Member
from catalogs.store.description import DESCRIPTION
from catalogs.store.journal import key_of
from catalogs.store.members import read_record
from catalogs.store.missing import missing_members, report_missing
from catalogs.store.pictures import pack_of, stored_picture
from catalogs.tools.transfer import add_members, pictures_of, place_pictures, summary_of
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import shortened

Progress = Callable[[str, int, int], None]
TOLD = 5  # members that an error names
SIMPLE = {
    "bounds": "bounds",
    "background": "background",
    "image_format": "encoding",
    "fields": "names or units of fields",
}


@dataclass(frozen=True)
class Merged:
    """How many members were added, how many were there already, and how many of the new ones' pictures had to be copied."""

    added: int
    same: int
    copied: int


def merge(
    into: str | os.PathLike[str],
    sources: Sequence[str | os.PathLike[str]],
    *,
    progress: Progress = lambda stage, done, total: None,
) -> Merged:
    """Add the members of the catalogs `sources` to the catalog `into`, which is made like the first of them if it is not there.

    A member that is in several, with equal parameters, split, cameras, appearances and pictures (pixel by pixel), is once there,
    as the first of them has it.  `progress` is called with the stage ("comparing", "merging"), and members done and in all.

    Raises CatalogError before anything is written, naming what differs between the catalogs' plans (provenance aside), members of
    equal names or parameters that differ in anything else, or a picture that is missing.
    """
    into, given = Path(into), [Path(source) for source in sources]
    _refuse_repeated([into, *given])
    known = [Catalog.open(into)] if (into / DESCRIPTION).exists() else []
    catalogs = [*known, *map(Catalog.open, given)]
    _refuse_mixed_layouts(catalogs)
    for other in catalogs[1:]:
        _refuse_other_plan(catalogs[0], other)
    wanted, same = _wanted(catalogs, len(known), progress)
    target = Catalog.create(into, catalogs[0].plan)
    copied = 0

    def fill(source: Catalog, member: Member, folder: Path) -> None:
        nonlocal copied
        copied += place_pictures(source, member, folder)

    add_members(target, wanted, fill, lambda done, total: progress("merging", done, total))
    _tell_missing(target, catalogs)
    return Merged(len(wanted), same, copied)


def plan_disagreements(mine: CatalogPlan, theirs: CatalogPlan) -> list[str]:
    """What two plans differ in, provenance aside, with both values: sentences."""
    found = []
    for key in mine.differences(theirs):
        if key == "cameras":
            found.append(_camera_disagreement(mine, theirs))
        elif key == "view_splits":
            found.append("splits of views: other views are for training, validation or test")
        elif key == "parameters":
            found.append(f"parameters: {mine.space} against {theirs.space}")
        elif key == "appearances":
            found.append(_appearance_disagreement(mine, theirs))
        elif key in SIMPLE:
            values = (plan.to_json().get(key) for plan in (mine, theirs))
            found.append(f"{SIMPLE[key]}: {' against '.join(map(str, values))}")
        else:
            found.append(f"{key}: others")
    return found


def _camera_disagreement(mine: CatalogPlan, theirs: CatalogPlan) -> str:
    counts = [len(plan.cameras) for plan in (mine, theirs)]
    if counts[0] != counts[1]:
        return f"views: {' against '.join(str(count or 'those of each member') for count in counts)}"
    sizes = [sorted({f"{c.width}x{c.height}" for c in plan.cameras}) for plan in (mine, theirs)]
    if sizes[0] != sizes[1]:
        return f"image size: {' against '.join(map(shortened, sizes))} pixels"
    pairs = zip(_records(mine.cameras), _records(theirs.cameras), strict=True)
    number = next(i for i, (a, b) in enumerate(pairs) if a != b)
    return f"cameras: view {number} and maybe others stand elsewhere"


def _appearance_disagreement(mine: CatalogPlan, theirs: CatalogPlan) -> str:
    names = [plan.appearance_names for plan in (mine, theirs)]
    if set(names[0]) != set(names[1]):
        return f"appearances: {' against '.join(map(shortened, names))}"
    kept = {a.name: a for a in theirs.appearances}
    changed = [a.name for a in mine.appearances if a != kept[a.name]]
    return f"appearances: {shortened(changed) + ' look otherwise' if changed else 'in another order'}"


def _refuse_repeated(paths: Sequence[Path]) -> None:
    places = [path.resolve() for path in paths]
    repeated = sorted({str(path) for path, place in zip(paths, places, strict=True) if places.count(place) > 1})
    if repeated or len(paths) < 2:
        raise CatalogError(
            f"name one catalog to merge into and others to take members from, each once: {repeated or paths}"
        )


def _refuse_mixed_layouts(catalogs: Sequence[Catalog]) -> None:
    packed = [catalog for catalog in catalogs if catalog.plan.packed]
    if packed and len(packed) < len(catalogs):
        other = next(catalog for catalog in catalogs if not catalog.plan.packed)
        raise CatalogError(
            f"{packed[0].path} is packed and {other.path} is not: `catalogs unpack` the one, or `catalogs pack` the other, first"
        )


def _refuse_other_plan(first: Catalog, other: Catalog) -> None:
    differing = plan_disagreements(first.plan, other.plan)
    if differing:
        raise CatalogError(
            f"{other.path} can't be merged with {first.path}, they are not of one scene: {'; '.join(differing)}"
        )


def _wanted(catalogs: Sequence[Catalog], known: int, progress: Progress) -> tuple[list[tuple[Catalog, str]], int]:
    """Members to add, and how many are there or come twice; the first `known` catalogs have theirs already."""
    by_key: dict[str, tuple[Catalog, str]] = {}
    names: set[str] = set()
    wanted, conflicts, same = [], [], 0
    paths = [(catalog, path) for catalog in catalogs for path in catalog.member_paths()]
    for number, (catalog, path) in enumerate(paths, start=1):
        member = read_record(path, catalog.plan)
        key = key_of(member.parameters)
        if key in by_key:
            other, name = by_key[key]
            difference = _difference(other, other.member(name), catalog, member)
            if difference:
                conflicts.append(f"{member.name} of {catalog.path} and {name} of {other.path} differ in {difference}")
            same += not difference
        elif member.name in names:
            conflicts.append(f"{member.name} of {catalog.path} has the name of a member with other parameters")
        else:
            by_key[key] = catalog, member.name
            names.add(member.name)
            if catalog not in catalogs[:known]:
                _refuse_incomplete(catalog, member)
                wanted.append((catalog, member.name))
        progress("comparing", number, len(paths))
    if conflicts:
        more = f"; and {len(conflicts) - TOLD} more" if len(conflicts) > TOLD else ""
        remedy = (
            "take the folders of wrong ones out of their catalogs' members/, then run `catalogs check --repair` there"
        )
        raise CatalogError(f"nothing was merged: {'; '.join(conflicts[:TOLD])}{more}: {remedy}")
    return wanted, same


def _difference(one: Catalog, first: Member, other: Catalog, second: Member) -> str:
    """What two members of equal parameters differ in, "" where they are equal; names, summaries and provenance may differ."""
    for what in ("split", "view_splits", "appearances"):
        if getattr(first, what) != getattr(second, what):
            return what.replace("_", " ")
    if not one.plan.cameras and _records(first.cameras) != _records(second.cameras):
        return "cameras"
    for appearance in first.appearances:
        for view in range(len(first.cameras)):
            if not _same_picture(one, first, other, second, appearance, view):
                return f"the picture {one.plan.image_name(appearance, view)}"
    return ""


def _records(cameras: Sequence[Camera]) -> list[Any]:
    return [camera.to_json() for camera in cameras]


def _same_picture(one: Catalog, first: Member, other: Catalog, second: Member, appearance: str, view: int) -> bool:
    paths = one.image_path(first, appearance, view), other.image_path(second, appearance, view)
    if os.path.samefile(*paths):
        return True
    if not one.plan.packed and durable.read(paths[0]) == durable.read(paths[1]):
        return True
    mine = stored_picture(first, one.plan, appearance, view)
    theirs = stored_picture(second, other.plan, appearance, view)
    return mine.dtype == theirs.dtype and np.array_equal(mine, theirs)


def _refuse_incomplete(catalog: Catalog, member: Member) -> None:
    """Raise CatalogError for a picture that is not there, and for links, which could lead out of the catalog."""
    pictures = pictures_of(catalog, member)
    folders = dict.fromkeys([member.path, *(path.parent for path in pictures)])
    for path in [*folders, *pictures, *summary_of(member)]:
        belongs = stat.S_ISDIR if path in folders else stat.S_ISREG
        if not path.exists() or not belongs(path.lstat().st_mode):
            problem = "is a link or no file" if path.exists() else "is missing"
            raise CatalogError(f"nothing was merged: {path} {problem}: `catalogs check {catalog.path}` tells more")
    if catalog.plan.packed:
        _ = pack_of(member)  # says what is wrong with its index


def _tell_missing(target: Catalog, catalogs: Sequence[Catalog]) -> None:
    """Keep what the catalogs report as missing, where no other had it."""
    reported = {member.name for member in missing_members(target.path)}
    for member in (member for catalog in catalogs for member in catalog.missing):
        if member.name not in reported and member.name not in target:
            with suppress(OSError):
                report_missing(target.path, member.name, member.parameters, member.reason)
