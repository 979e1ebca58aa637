"""Small ensembles of known truth, stored as catalogs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from catalogs.appearance import ImportedImages
from catalogs.catalog import Catalog, CatalogPlan
from tests.support.blobs import Blobs

MakeCatalog = Callable[..., Catalog]


@pytest.fixture
def make_catalog(tmp_path: Path) -> MakeCatalog:
    """Stores an ensemble of blobs: members (split, p), the first views of the icosphere, blank or on a background."""

    def make(
        blobs: Blobs = Blobs(),  # noqa: B008 - immutable
        *,
        members: Sequence[tuple[str, float]] = (("train", 0.0), ("train", 0.5), ("train", 1.0)),
        view_splits: Sequence[str] = ("train",) * 10 + ("validation", "test"),
        background: tuple[float, float, float] | None = None,
        blank: bool = False,
        name: str = "blobs.cdb",
    ) -> Catalog:
        cameras = blobs.cameras()[: len(view_splits)]
        plan = CatalogPlan(
            space=blobs.space,
            appearances=(ImportedImages("drawn"),),
            cameras=cameras,
            view_splits=tuple(view_splits),
            bounds=blobs.bounds,
            background=background,
        )
        catalog = Catalog.create(tmp_path / name, plan)
        for i, (split, p) in enumerate(members):
            with catalog.begin_member(f"member-{i}", {"p": p}, split=split) as writer:
                for view, camera in enumerate(cameras):
                    picture = np.zeros((blobs.size, blobs.size, 4), np.float32) if blank else blobs.picture(p, camera)
                    if background is not None:
                        picture[..., :3] += (1.0 - picture[..., 3:]) * np.array(background, np.float32)
                        picture[..., 3] = 1.0
                    writer.write_image("drawn", view, picture)
        return Catalog.open(tmp_path / name)

    return make


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of a report's words and numbers: its figures are made but not drawn, which takes seconds."""
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda _, path, **__: Path(path).write_bytes(b"undrawn"))
