"""A run whose stored pictures its own surrogate drew, and the explorer of it, running."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from surrogate.explore.run import Run
from tests.support import families
from tests.support.browsers import DESKTOP, watch
from tests.support.explored import open_explorer
from tests.support.field_blobs import BLOBS, FUNCTION, FUNCTIONS, ISOVALUE, summary
from tests.support.models import following

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

MEMBERS = {"train-0": 0.0, "train-1": 0.5, "train-2": 1.0, "validation-0": 0.25, "test-0": 0.75} | {
    "train-3": 0.9, "validation-1": 0.6, "validation-2": 0.85
}  # fmt: skip
VIEW_SPLITS = ("train",) * 8 + ("validation",) * 2 + ("test",) * 2


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`surrogate/` and `catalog.cdb/` of members that show the base, isosurfaces and transfer functions."""
    folder = tmp_path_factory.mktemp("runs") / "blobs"
    surrogate = following()
    surrogate.save(folder / "surrogate")
    shown = [families.BASE, *(s.appearance for v in (ISOVALUE, FUNCTIONS) for s in v.settings)]
    asked = {s.appearance: v.arguments(s) for v in (ISOVALUE, FUNCTIONS) for s in v.settings}
    families.family_catalog(
        folder / "catalog.cdb",
        BLOBS,
        FUNCTION,
        (ISOVALUE, FUNCTIONS),
        {name: (name.split("-")[0], p, shown) for name, p in MEMBERS.items()},
        lambda p, appearance: partial(surrogate.at(p=p, **asked.get(appearance.name, {})).render),
        view_splits=VIEW_SPLITS,
        summary=summary(BLOBS),
    )
    return folder


@pytest.fixture
def own_run(run_folder: Path, tmp_path: Path) -> Path:
    """A copy of the run for one test alone: what is measured of it lies there."""
    return Path(shutil.copytree(run_folder, tmp_path / "blobs"))


@pytest.fixture(scope="session")
def explorer(run_folder: Path) -> Iterator[str]:
    """The address of the run's explorer; skips without aiohttp."""
    pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")
    from surrogate.explore.server.notebook import NotebookExplorer

    shown = NotebookExplorer(Run.open(run_folder))
    yield shown.address
    shown.close()


@pytest.fixture(scope="session")
def surrogate(run_folder: Path) -> Surrogate:
    """The run's."""
    return Surrogate.load(run_folder / "surrogate")


@pytest.fixture(scope="session")
def modules(browser: Browser, explorer: str) -> Iterator[Page]:
    """One tab for all tests that only call functions of the page's modules and change nothing in it."""
    complaints: list[str] = []
    context = browser.new_context(viewport=DESKTOP)
    watch(context, complaints)
    page = context.new_page()
    open_explorer(page, explorer)
    yield page
    context.close()
    assert complaints == []
