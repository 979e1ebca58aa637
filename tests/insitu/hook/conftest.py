"""Fixtures of the hook's tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.hooked import render


@pytest.fixture
def catalog(tmp_path: Path) -> Path:
    """A catalog of one member."""
    path = tmp_path / "a.cdb"
    render(path)
    return path
