"""Members of one catalog taken over into another, many in one commit; an interrupted transfer goes on where it stopped."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from catalogs.files import durable
from catalogs.store.catalog import Catalog, Member
from catalogs.store.members import SUMMARY, write_record

AT_ONCE = 256  # members in a commit

Fill = Callable[[Catalog, Member, Path], object]


def add_members(
    target: Catalog, wanted: Sequence[tuple[Catalog, str]], fill: Fill, progress: Callable[[int, int], None]
) -> None:
    """Add members, given by their catalogs and names, to a catalog of the same views and appearances, and bring its table in order.

    `fill` writes a member's pictures into the hidden folder that is to be its own; summary and record are taken over here.
    """
    for first in range(0, len(wanted), AT_ONCE):
        made: list[Member] = []
        try:
            for done, (source, name) in enumerate(wanted[first : first + AT_ONCE], start=first + 1):
                member = source.member(name)
                new = replace(member, path=target.unfinished_folder(name))
                made.append(new)
                fill(source, member, new.path)
                for path in summary_of(member):
                    place(path, new.path / path.name)
                write_record(new, target.plan)
                durable.sync_tree(new.path)
                progress(done, len(wanted))
            target.adopt(made)
        finally:
            for new in made:
                shutil.rmtree(new.path, ignore_errors=True)
    target.rebuild_table()  # rows in the order of names, whatever was interrupted


def summary_of(member: Member) -> list[Path]:
    """The member's file of summaries, if there is one."""
    path = member.path / SUMMARY
    return [path] if path.is_file() else []


def pictures_of(catalog: Catalog, member: Member) -> list[Path]:
    """The files of a member's pictures, each once: one for each, or one for all."""
    paths = (catalog.image_path(member, a, view) for a in member.appearances for view in range(len(member.cameras)))
    return list(dict.fromkeys(paths))


def place_pictures(catalog: Catalog, member: Member, folder: Path) -> int:
    """Give a member's picture files a further place in `folder`, see `place`; returns how many were copied."""
    return sum(place(path, folder / path.relative_to(member.path)) for path in pictures_of(catalog, member))


def place(source: Path, target: Path) -> bool:
    """Give a stored file a further place in a folder nobody sees yet, as a link where that is possible; whether it was copied."""
    target.parent.mkdir(exist_ok=True)
    try:
        durable.link(source, target)
    except OSError:  # another file system, one without hard links, or too many of them
        durable.copy(source, target)
        return True
    return False
