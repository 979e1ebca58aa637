"""Writing one member of a catalog: its images, and the files of its fields."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import write_image
from catalogs.store.coarse import CoarseField, save_coarse_fields
from catalogs.store.digests import Digests
from catalogs.store.members import COARSE, SUMMARY, Member, stored_names
from catalogs.store.plan import CatalogError, CatalogPlan
from catalogs.store.sizes import Sizes
from catalogs.store.summary import FieldSummary, save_summaries
from catalogs.vocabulary.words import shortened


class MemberWriter:
    """Writer of one member in a hidden folder; leaving the `with` block commits it, an exception discards it."""

    def __init__(self, plan: CatalogPlan, member: Member, commit: Callable[[MemberWriter], None]) -> None:
        self._plan, self._commit = plan, commit
        self.member = member
        self._written: dict[tuple[str, int], str] = {}  # digests of images
        self._files: dict[str, str] = {}  # digests of other files
        self.sizes = Sizes(views=len(member.cameras))

    @property
    def path(self) -> Path:
        """The hidden folder of the unfinished member."""
        return self.member.path

    def write_image(self, appearance: str, view: int, rgba: NDArray[Any]) -> None:
        """Store premultiplied RGBA [H, W, 4], uint8 or float32 in [0, 1], of the camera's size.

        Raises CatalogError for an unknown appearance or view, another size, or a transparent image where the catalog has a
        background.  Raises ValueError for another dtype or NaN, and OSError where the disk refuses.
        """
        plan = self._plan
        if appearance not in self.member.appearances:
            raise CatalogError(f"no appearance {appearance!r}; the member has {shortened(self.member.appearances)}")
        if not 0 <= view < len(self.member.cameras):
            raise CatalogError(f"view {view} does not exist: there are {len(self.member.cameras)}")
        camera = self.member.cameras[view]
        if rgba.shape != (camera.height, camera.width, 4):
            raise CatalogError(f"view {view} must be {camera.height}x{camera.width} RGBA, got shape {rgba.shape}")
        if plan.background is not None and (rgba[..., 3] < (255 if rgba.dtype == np.uint8 else 1.0)).any():
            raise CatalogError(
                f"view {view} of {appearance} is transparent, but this catalog's images are opaque on the background "
                f"{plan.background}: composite it first, rgb + (1 - alpha) * background"
            )
        path = self.path / plan.image_name(appearance, view)
        path.parent.mkdir(exist_ok=True)
        self._written[appearance, view] = write_image(path, rgba)
        self.sizes = replace(self.sizes, images=self.sizes.images + path.stat().st_size)

    def write_summaries(self, summaries: Mapping[str, FieldSummary]) -> None:
        """Store summaries of the member's fields, by name ("" for a single field), beside the images."""
        self._files[SUMMARY] = save_summaries(self.path / SUMMARY, stored_names(summaries, self._plan))

    def write_coarse_fields(self, coarse: Mapping[str, CoarseField]) -> None:
        """Store the member's coarse fields, by name ("" for a single field), beside the images."""
        self._files[COARSE] = save_coarse_fields(self.path / COARSE, stored_names(coarse, self._plan))
        whole = all(field.whole for field in coarse.values())
        self.sizes = replace(self.sizes, fields=(self.path / COARSE).stat().st_size, whole=whole)

    def add_provenance(self, **values: Any) -> None:
        """Add JSON values to the member's provenance."""
        self.member = replace(self.member, provenance={**self.member.provenance, **values})

    def missing(self) -> list[tuple[str, int]]:
        """(appearance, view) pairs that are not written yet."""
        views = range(len(self.member.cameras))
        return [(a, v) for a in self.member.appearances for v in views if (a, v) not in self._written]

    def digests(self) -> Digests:
        """Digests of all files that were written."""
        views = range(len(self.member.cameras))
        images = {a: "".join(self._written[a, v] for v in views) for a in self.member.appearances}
        return Digests(images, self._files)

    def __enter__(self) -> MemberWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._commit(self)
        finally:
            shutil.rmtree(self.path, ignore_errors=True)
