"""Fixtures of the server's tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.support.tabs import Tab


@pytest.fixture
def tab(explorer: str) -> Iterator[Tab]:
    """An open connection to the run's explorer."""
    from tests.support.tabs import Tab

    with Tab(explorer) as opened:
        yield opened
