"""A run of two parameters that is an emulated field, and its explorer, running."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from surrogate.explore.run import Run
from tests.support.two_parameters import run_in


@pytest.fixture(scope="session")
def two_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The run."""
    return Run.open(run_in(tmp_path_factory.mktemp("runs") / "two"))


@pytest.fixture(scope="session")
def two(two_run: Run) -> Iterator[str]:
    """The address of its explorer; skips without aiohttp."""
    pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")
    from surrogate.explore.server.notebook import NotebookExplorer

    shown = NotebookExplorer(two_run)
    yield shown.address
    shown.close()
