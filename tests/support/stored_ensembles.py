"""Small ensembles of known truth, stored as catalogs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from catalogs.store.catalog import Catalog
from tests.support import prepared
from tests.support.blobs import Blobs, stored

MakeCatalog = Callable[..., Catalog]


@pytest.fixture
def make_catalog(tmp_path: Path) -> MakeCatalog:
    """Stores an ensemble of blobs, see `tests.support.blobs.stored`."""

    def make(blobs: Blobs = Blobs(), *, name: str = "blobs.cdb", **options: Any) -> Catalog:  # noqa: B008 - immutable
        return stored(tmp_path / name, blobs, **options)

    return make


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of a report's words and numbers: its figures are made but not drawn, which takes seconds."""
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda _, path, **__: Path(path).write_bytes(b"undrawn"))


@pytest.fixture
def prepared_workers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of what an ensemble renders: its workers are forked; how they start and end is tested where they are not.

    The few that are not slow would not pay for the process to fork from.
    """
    if request.node.get_closest_marker("slow"):
        monkeypatch.setattr("insitu.ensembles.workers.SPAWNED", prepared.CONTEXT)
