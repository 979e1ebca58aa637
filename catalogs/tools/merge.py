"""Merging of catalogs of one scene, rendered on different machines or by interrupted runs.

All members are compared before anything is written.  Then members are added, many per commit; after an interruption the same
command resumes.  Images are linked where the file system allows it and so take no further space: no code here changes a stored
image.
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
from catalogs.tools.transfer import add_members, field_files, image_files, link_images
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import joined_names, shortened

Progress = Callable[[str, int, int], None]
MOST_CONFLICTS = 5  # in an error message
LABELS = {"image_format": "encoding", "fields": "names or units of fields"}


@dataclass(frozen=True)
class Merged:
    """Numbers of members added, of members that several catalogs had, and of added images that were copied, not linked."""

    added: int
    same: int
    copied: int


def merge(
    into: str | os.PathLike[str],
    sources: Sequence[str | os.PathLike[str]],
    *,
    progress: Progress = lambda stage, done, total: None,
) -> Merged:
    """Add the members of the catalogs `sources` to the catalog `into`, which is created with the plan of the first if absent.

    A member of several catalogs, with equal parameters, split, cameras, appearances and images (pixel by pixel), is added once,
    from the first of them.  `progress` is called with the stage ("comparing", "merging"), and members done and in all.

    Raises CatalogError before anything is written, naming differences between the catalogs' plans (provenance aside), members of
    equal names or parameters that differ in anything else, or a missing image.
    """
    into, paths = Path(into), [Path(source) for source in sources]
    _refuse_repeated([into, *paths])
    existing = [Catalog.open(into)] if (into / DESCRIPTION).exists() else []
    catalogs = [*existing, *map(Catalog.open, paths)]
    _refuse_mixed_layouts(catalogs)
    for other in catalogs[1:]:
        if differing := plan_differences(catalogs[0].plan, other.plan):
            raise CatalogError(
                f"{other.path} can't be merged with {catalogs[0].path}, they are not of one scene: {'; '.join(differing)}"
            )
    new, same = _new_members(catalogs, len(existing), progress)
    target = Catalog.create(into, catalogs[0].plan)
    copied = add_members(target, new, link_images, lambda done, total: progress("merging", done, total))
    _copy_missing(target, catalogs)
    return Merged(len(new), same, copied)


def plan_differences(mine: CatalogPlan, theirs: CatalogPlan) -> list[str]:
    """Differences of two plans, provenance aside, as sentences with both values."""
    special = {
        "cameras": _camera_difference,
        "appearances": _appearance_difference,
        "view_splits": lambda mine, theirs: "splits of views",
        "parameters": lambda mine, theirs: f"parameters: {mine.space} against {theirs.space}",
        "variations": lambda mine, theirs: "variations",
    }
    records = mine.to_json(), theirs.to_json()
    return [
        special[key](mine, theirs)
        if key in special
        else f"{LABELS.get(key, key)}: {' against '.join(str(record.get(key)) for record in records)}"
        for key in mine.differences(theirs)
    ]


def _camera_difference(mine: CatalogPlan, theirs: CatalogPlan) -> str:
    counts = [len(plan.cameras) for plan in (mine, theirs)]
    if counts[0] != counts[1]:
        return f"views: {' against '.join(str(count or 'those of each member') for count in counts)}"
    sizes = [sorted({f"{c.width}x{c.height}" for c in plan.cameras}) for plan in (mine, theirs)]
    if sizes[0] != sizes[1]:
        return f"image size: {' against '.join(map(shortened, sizes))} pixels"
    pairs = zip(_records(mine.cameras), _records(theirs.cameras), strict=True)
    number = next(i for i, (a, b) in enumerate(pairs) if a != b)
    return f"cameras: view {number} and maybe others"


def _appearance_difference(mine: CatalogPlan, theirs: CatalogPlan) -> str:
    names = [plan.appearance_names for plan in (mine, theirs)]
    if set(names[0]) != set(names[1]):
        return f"appearances: {' against '.join(map(shortened, names))}"
    others = {a.name: a for a in theirs.appearances}
    changed = [a.name for a in mine.appearances if a != others[a.name]]
    return f"appearances: {'definition of ' + shortened(changed) if changed else 'order'}"


def _refuse_repeated(paths: Sequence[Path]) -> None:
    places = [path.resolve() for path in paths]
    repeated = sorted({str(path) for path, place in zip(paths, places, strict=True) if places.count(place) > 1})
    if repeated or len(paths) < 2:
        raise CatalogError(
            f"name one catalog to merge into and others to take members from, each once: {joined_names(repeated or paths)}"
        )


def _refuse_mixed_layouts(catalogs: Sequence[Catalog]) -> None:
    packed = [catalog for catalog in catalogs if catalog.plan.packed]
    if packed and len(packed) < len(catalogs):
        other = next(catalog for catalog in catalogs if not catalog.plan.packed)
        raise CatalogError(
            f"{packed[0].path} is packed and {other.path} is not: `catalogs unpack` the one, or `catalogs pack` the other, first"
        )


def _new_members(
    catalogs: Sequence[Catalog], existing: int, progress: Progress
) -> tuple[list[tuple[Catalog, str]], int]:
    """Members to add, and the number of repeated ones; the first `existing` catalogs are the target."""
    by_key: dict[str, tuple[Catalog, str]] = {}
    names: set[str] = set()
    new, conflicts, same = [], [], 0
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
            if catalog not in catalogs[:existing]:
                _refuse_incomplete(catalog, member)
                new.append((catalog, member.name))
        progress("comparing", number, len(paths))
    if conflicts:
        more = f"; and {len(conflicts) - MOST_CONFLICTS} more" if len(conflicts) > MOST_CONFLICTS else ""
        raise CatalogError(
            f"nothing was merged: {'; '.join(conflicts[:MOST_CONFLICTS])}{more}: take the folders of wrong ones out of "
            "their catalogs' members/, then run `catalogs check --repair` there"
        )
    return new, same


def _difference(one: Catalog, first: Member, other: Catalog, second: Member) -> str:
    """The first difference of two members of equal parameters, or ""; names, summaries and provenance may differ."""
    for attribute in ("split", "view_splits", "appearances"):
        if getattr(first, attribute) != getattr(second, attribute):
            return attribute.replace("_", " ")
    if not one.plan.cameras and _records(first.cameras) != _records(second.cameras):
        return "cameras"
    for appearance in first.appearances:
        for view in range(len(first.cameras)):
            if not _same_image(one, first, other, second, appearance, view):
                return f"the image {one.plan.image_name(appearance, view)}"
    return ""


def _records(cameras: Sequence[Camera]) -> list[Any]:
    return [camera.to_json() for camera in cameras]


def _same_image(one: Catalog, first: Member, other: Catalog, second: Member, appearance: str, view: int) -> bool:
    paths = one.image_path(first, appearance, view), other.image_path(second, appearance, view)
    if os.path.samefile(*paths):
        return True
    if not one.plan.packed and durable.read(paths[0]) == durable.read(paths[1]):
        return True
    mine = stored_picture(first, one.plan, appearance, view)
    theirs = stored_picture(second, other.plan, appearance, view)
    return mine.dtype == theirs.dtype and np.array_equal(mine, theirs)


def _refuse_incomplete(catalog: Catalog, member: Member) -> None:
    """Raise CatalogError for a missing image, and for links, which could lead out of the catalog."""
    images = image_files(catalog, member)
    folders = dict.fromkeys([member.path, *(path.parent for path in images)])
    for path in [*folders, *images, *field_files(member)]:
        has_kind = stat.S_ISDIR if path in folders else stat.S_ISREG
        if not path.exists() or not has_kind(path.lstat().st_mode):
            problem = "is a link or not a file" if path.exists() else "is missing"
            raise CatalogError(f"nothing was merged: {path} {problem}: `catalogs check {catalog.path}` says more")
    if catalog.plan.packed:
        _ = pack_of(member)  # validates its index


def _copy_missing(target: Catalog, catalogs: Sequence[Catalog]) -> None:
    """Copy reports of missing members that the target has neither stored nor reported."""
    reported = {member.name for member in missing_members(target.path)}
    for member in (member for catalog in catalogs for member in catalog.missing):
        if member.name not in reported and member.name not in target:
            with suppress(OSError):
                report_missing(target.path, member.name, member.parameters, member.reason)
