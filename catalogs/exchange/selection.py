"""The pictures of a catalog that are exported."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import shortened


@dataclass(frozen=True)
class SelectedImage:
    """One image of a selection: its member, view and split (as in the catalog's table)."""

    member: Member
    view: int
    split: str

    @property
    def camera(self) -> Camera:
        return self.member.cameras[self.view]


@dataclass(frozen=True)
class Selection:
    """Images of some members of a catalog in one appearance."""

    catalog: Catalog
    members: tuple[Member, ...]
    appearance: str

    def __repr__(self) -> str:
        return f"<Selection of {shortened([member.name for member in self.members])} of {self.catalog.path}, {self.appearance}>"

    def pictures(self) -> Iterator[SelectedImage]:
        """All images, member by member."""
        for member in self.members:
            yield from self.of(member)

    def of(self, member: Member) -> list[SelectedImage]:
        """The images of one member."""
        setting = self.catalog.plan.setting(self.appearance)
        return [SelectedImage(member, view, member.row_split(view, setting)) for view in range(len(member.cameras))]
