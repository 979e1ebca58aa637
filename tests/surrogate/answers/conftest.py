"""Runs of three parameters, of which one changes much, one less and one nothing, and of two, of which one is seen."""

from __future__ import annotations

from pathlib import Path

import pytest

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from surrogate.model import Surrogate
from tests.support.finished_runs import finish
from tests.support.hooked import FUNCTION
from tests.support.three_parameters import SPACE, SPACING, shown
from tests.support.two_parameters import run_in


@pytest.fixture(scope="session")
def three(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its folder: a catalog beside Gaussians and an emulated field."""
    folder = tmp_path_factory.mktemp("run")
    views = ViewPlan(frequency=1, width=32, height=32)
    appearance = VolumeRendering("dvr", FUNCTION)
    with insitu.Session(folder / "catalog.cdb", space=SPACE, appearances=[appearance], views=views) as session:
        for split, rows in (("train", SPACE.latin_hypercube(24, 0)), ("validation", SPACE.latin_hypercube(2, 1))):
            for row in rows:
                parameters = dict(zip(SPACE.names, map(float, row), strict=True))
                session.render_member(shown(**parameters), parameters, spacing=SPACING, split=split)
    return finish(folder, only_field=False)


@pytest.fixture(scope="session")
def surrogate_of_three(three: Path) -> Surrogate:
    return Surrogate.load(three / "surrogate")


@pytest.fixture(scope="session")
def catalog_of_three(three: Path) -> Catalog:
    return Catalog.open(three / "catalog.cdb")


@pytest.fixture(scope="session")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of two."""
    return run_in(tmp_path_factory.mktemp("two"))
