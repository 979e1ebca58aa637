"""The run that an explorer shows: its surrogate, and its catalog where it is still there."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from catalogs.vocabulary.variations import origins_of
from catalogs.vocabulary.words import joined_names
from surrogate.explore.setting import base_function
from surrogate.model import Surrogate
from surrogate.storage.runs import MODEL, RunFolder

SIDE = 512  # pixels of pictures where no catalog says another size


@dataclass(frozen=True, eq=False)
class Run:
    """A surrogate with its catalog and folder."""

    title: str  # of the window
    surrogate: Surrogate
    model_folder: Path | None = None  # where it was loaded from; None for one that is only in memory
    catalog: Catalog | None = None  # the pictures that it was trained on; None where they are gone
    folder: Path | None = None  # what is measured for the explorer is kept below it; None where nothing can be
    missing: str = ""  # why there is no catalog, and what helps

    def __repr__(self) -> str:
        return f"<Run {self.title!r}: {self.surrogate!r}>"

    @cached_property
    def members(self) -> tuple[Member, ...]:
        """The catalog's members, those committed when this is first asked; none without a catalog.

        Raises CatalogError for a damaged catalog, ValueError for one of other simulation parameters.
        """
        if self.catalog is None:
            return ()
        names, own = self.catalog.plan.space.names, self.surrogate.space.names
        if names != own:
            raise ValueError(f"the catalog is of {joined_names(names)}, the surrogate of {joined_names(own)}")
        return self.catalog.members

    @cached_property
    def cameras(self) -> Sequence[Camera]:
        """The viewpoints that all members share, else those of each; where none are stored, 252 around the whole volume."""
        cameras = () if self.catalog is None else self.catalog.plan.cameras
        placed = self.surrogate.normalization
        return (
            cameras
            or [camera for member in self.members for camera in member.cameras]
            or orbit(placed.center, 3.0**0.5 * placed.extent, width=SIDE, height=SIDE)
        )

    @cached_property
    def base_function(self) -> TransferFunction | None:
        """The transfer function that control points are displaced from; None where there is none, or nobody knows it."""
        bases = [v.base for v in self.surrogate.variations if v.edits_base]
        appearances = self.catalog.plan.appearances if self.catalog and bases else ()
        functions = (a.transfer_function for a in appearances if isinstance(a, VolumeRendering) and a.name in bases)
        return base_function(self.surrogate) or next(functions, None)

    @cached_property
    def origins(self) -> dict[str, float]:
        """Values and opacities of the inner control points of `base_function`, by the names of their displacements."""
        return origins_of(self.base_function)

    @property
    def middle(self) -> NDArray[np.float64]:
        """The centre of the catalog's box, (3,) world coordinates; without a catalog of the whole volume."""
        whole = self.surrogate.normalization.center
        return whole if self.catalog is None else np.mean(self.catalog.plan.bounds, axis=0)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Run:
        """The run in the folder `path`, such as `runs/tgv`, or that of a surrogate alone.

        Raises FileNotFoundError where there is no surrogate, ValueError for a damaged one, CatalogError for a damaged catalog.
        """
        folder = Path(path)
        if Surrogate.exists(folder) and not Surrogate.exists(folder / MODEL):
            return cls(folder.resolve().name, Surrogate.load(folder), folder)
        run = RunFolder.open(folder)
        surrogate = Surrogate.load(run.model)
        return cls(run.name, surrogate, run.model, None if run.missing else run.catalog, folder, run.missing)
