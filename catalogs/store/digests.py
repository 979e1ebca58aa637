"""Digests of a member's files, kept in its record: of each image, of its other files, and of the plan that it was made with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from catalogs.files.digests import LENGTH


@dataclass(frozen=True, slots=True)
class Digests:
    """Digests (see `catalogs.files.digests`) of one member; empty where none were recorded.

    Attributes
    ----------
    images : those of an appearance's image files by its name, view after view, joined; in a packed catalog of the unpacked files.
    files : those of `field.npz`, `coarse.npz`, `cameras.json` and `pictures.h5`, as far as there are such files, by their names.
    plan : `CatalogPlan.digest` of the catalog that the member was written into.
    """

    images: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    plan: str = ""

    def __repr__(self) -> str:
        count = sum(len(images) // LENGTH for images in self.images.values())
        return f"<Digests of {count} images, {', '.join(self.files) or 'no other files'}>"

    def image(self, appearance: str, view: int) -> str:
        """The digest of an image's file, "" where none was recorded."""
        return self.images.get(appearance, "")[LENGTH * view : LENGTH * (view + 1)]

    def to_json(self) -> dict[str, Any]:
        """JSON values for `from_json`."""
        return {"plan": self.plan, "files": dict(self.files), "images": dict(self.images)}

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Digests:
        """The digests of a `to_json` record; raises KeyError, TypeError or ValueError for a malformed one."""
        return cls(dict(record["images"]), dict(record["files"]), str(record["plan"]))
