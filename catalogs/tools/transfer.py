"""Transfer of members from one catalog to another, many per commit; an interrupted transfer can be resumed."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from catalogs.files import durable
from catalogs.store.catalog import Catalog, Member
from catalogs.store.digests import Digests
from catalogs.store.members import FIELD_FILES, read_member, write_record
from catalogs.store.table import MEMBERS

AT_ONCE = 256  # members per commit

Fill = Callable[[Catalog, Member, Path, Digests], tuple[int, Digests]]
Progress = Callable[[int, int], None]


def add_members(
    target: Catalog, members: Sequence[tuple[Catalog, str]], fill: Fill, progress: Progress = lambda done, total: None
) -> int:
    """Add members, given by their catalogs and names, to a catalog of the same views and appearances.

    `fill` writes a member's images into its hidden folder, counts some of them, and makes the new digests of the stored ones; the
    sum of counts is returned.  Summaries, coarse fields and record are copied here, and the table is sorted at the end.
    """
    counted = 0
    for first in range(0, len(members), AT_ONCE):
        written: list[Member] = []
        try:
            for done, (source, name) in enumerate(members[first : first + AT_ONCE], start=first + 1):
                member, digests = read_member(source.path / MEMBERS / name, source.plan)
                new = replace(member, path=target.unfinished_folder(name))
                written.append(new)
                count, digests = fill(source, member, new.path, digests)
                counted += count
                for path in field_files(member):
                    _place(path, new.path / path.name)
                write_record(new, target.plan, digests)
                durable.sync_tree(new.path)
                progress(done, len(members))
            target.adopt(written)
        finally:
            for new in written:
                shutil.rmtree(new.path, ignore_errors=True)
    target.rebuild_table()  # sorted by name, whatever was interrupted
    return counted


def field_files(member: Member) -> list[Path]:
    """The member's files of summaries and coarse fields, as far as it has them."""
    return [path for path in (member.path / name for name in FIELD_FILES) if path.is_file()]


def image_files(catalog: Catalog, member: Member) -> list[Path]:
    """The member's image files, or its pack."""
    paths = (catalog.image_path(member, a, view) for a in member.appearances for view in range(len(member.cameras)))
    return list(dict.fromkeys(paths))


def link_images(catalog: Catalog, member: Member, folder: Path, digests: Digests) -> tuple[int, Digests]:
    """Link a member's image files into `folder`, or copy those that can't be linked; returns how many were copied."""
    copied = sum(_place(path, folder / path.relative_to(member.path)) for path in image_files(catalog, member))
    return copied, digests


def _place(source: Path, target: Path) -> bool:
    """Link a file into a folder that nobody reads yet, or copy it; True where it was copied."""
    target.parent.mkdir(exist_ok=True)
    try:
        durable.link(source, target)
    except OSError:  # another file system, one without hard links, or too many links
        durable.copy(source, target)
        return True
    return False
