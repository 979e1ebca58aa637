"""Bytes of images and of coarse fields side by side, and advice where the images are many more."""

from __future__ import annotations

import os
from dataclasses import dataclass
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
    images, fields : of images and of coarse fields.
    views : of each appearance, at most.
    whole : True if all coarse fields are the members' own samples.
    """

    images: int = 0
    fields: int = 0
    views: int = 0
    whole: bool = False

    def __add__(self, other: Sizes) -> Sizes:
        whole = self.whole and other.whole
        return Sizes(self.images + other.images, self.fields + other.fields, max(self.views, other.views), whole)

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
    names = (member.path / name for name in (*member.appearances, PACK))
    images = sum(bytes_of(path) for path in names)
    coarse = member.path / COARSE
    return Sizes(images, bytes_of(coarse), len(member.cameras), coarse.exists() and are_whole(coarse))


def bytes_of(path: str | Path) -> int:
    """Size of a file, or of all files in and below a folder; 0 where there is none."""
    if not os.path.isdir(path):
        return os.stat(path).st_size if os.path.isfile(path) else 0
    with os.scandir(path) as entries:
        return sum(
            bytes_of(entry.path) if entry.is_dir(follow_symlinks=False) else entry.stat().st_size
            for entry in entries
            if entry.is_dir(follow_symlinks=False) or entry.is_file()
        )


def size(count: float) -> str:
    """Bytes in words."""
    for unit, name in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if count >= unit:
            return f"{count / unit:,.3g} {name}"
    return plural(round(count), "byte")
