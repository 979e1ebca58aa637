"""Bytes of images and of coarse fields side by side, and advice where the images are many more."""

from __future__ import annotations

import os
from collections.abc import Container
from dataclasses import dataclass, field
from pathlib import Path

from catalogs.files.packed import PACK
from catalogs.store.coarse import are_whole
from catalogs.store.members import COARSE, Member
from catalogs.vocabulary.words import plural

FEWER_VIEWS = 42  # of which the scene cloverleaf, whose fields are kept whole, loses nothing measurable


@dataclass(frozen=True)
class Sizes:
    """Bytes in one member, or in several.

    Attributes
    ----------
    images, fields, others : of images, of coarse fields, and of all other files.
    views : of each appearance, at most.
    whole : True if all coarse fields are the members' own samples.
    """

    images: int = 0
    fields: int = 0
    views: int = 0
    whole: bool = False
    others: int = field(default=0, compare=False)

    def __add__(self, other: Sizes) -> Sizes:
        return Sizes(
            self.images + other.images,
            self.fields + other.fields,
            max(self.views, other.views),
            self.whole and other.whole,
            self.others + other.others,
        )

    def __repr__(self) -> str:
        return f"<Sizes: {self}, at most {self.views} views>"

    def __str__(self) -> str:
        fields = f"{size(self.fields)} of fields" if self.fields else "no coarse fields"
        return f"{size(self.images)} of images, {fields}"

    @property
    def advice(self) -> str:
        """A sentence where fewer views may do; "" elsewhere."""
        if not self.whole or self.views <= FEWER_VIEWS or self.images <= self.fields:
            return ""
        return (
            f"the fields are kept whole: fewer than {self.views} views may do ({FEWER_VIEWS}, frequency 2, lose nothing "
            "measurable in the scene cloverleaf)"
        )


def sizes_of(member: Member) -> Sizes:
    """The sizes of a member's files; raises ValueError for damaged coarse fields."""
    with os.scandir(member.path) as entries:
        by_name = {entry.name: _bytes_of_entry(entry) for entry in entries}
    images = sum(by_name.pop(name, 0) for name in (*member.appearances, PACK))
    fields, coarse = by_name.pop(COARSE, 0), member.path / COARSE
    whole = coarse.exists() and are_whole(coarse)
    return Sizes(images, fields, len(member.cameras), whole, sum(by_name.values()))


def bytes_of(path: str | Path, but: Container[str] = ()) -> int:
    """Size of a file, or of all files in and below a folder, `but` those of some paths; 0 where there is none."""
    if not os.path.isdir(path):
        return os.stat(path).st_size if os.path.isfile(path) else 0
    with os.scandir(path) as entries:
        return sum(_bytes_of_entry(entry, but) for entry in entries if entry.path not in but)


def _bytes_of_entry(entry: os.DirEntry[str], but: Container[str] = ()) -> int:
    if entry.is_dir(follow_symlinks=False):
        return bytes_of(entry.path, but)
    return entry.stat().st_size if entry.is_file() else 0


def size(count: float) -> str:
    """Bytes in words."""
    for unit, name in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if count >= unit:
            return f"{count / unit:,.3g} {name}"
    return plural(round(count), "byte")
