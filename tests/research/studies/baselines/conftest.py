"""Planes that train fast."""

from __future__ import annotations

import pytest

from research.studies.baselines import hexplane_field


@pytest.fixture
def small_planes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few nodes along space, and half as many members' places as nodes along a parameter."""
    monkeypatch.setattr(hexplane_field, "RESOLUTIONS", (12, 24))
    monkeypatch.setattr(hexplane_field, "PARAMETER_RESOLUTION", 7)
