"""Fixtures of the tests of comparisons."""

from __future__ import annotations

import pytest

from research.studies.comparison.task import ComparisonTask
from tests.research.support.comparisons import MEMBERS, SMALL, VIEWS
from tests.support.blobs import stored


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> ComparisonTask:
    return ComparisonTask.of(
        stored(tmp_path_factory.mktemp("task") / "blobs.cdb", SMALL, members=MEMBERS, view_splits=VIEWS)
    )
