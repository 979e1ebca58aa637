"""The examples run, and leave what they say."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from catalogs import Catalog
from catalogs.scene import ViewPlan

PROJECT = Path(__file__).resolve().parent.parent


def test_gray_scott(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = importlib.util.spec_from_file_location("gray_scott", PROJECT / "examples/gray_scott.py")
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    patterns = {time: v.copy() for time, v in example.gray_scott(0.03, 0.056, (0, 40), 16)}
    assert float(patterns[0].max()) == 0.25
    assert np.isfinite(patterns[40]).all()
    # A short run in place of each: the times are those that a member says.
    monkeypatch.setattr(example, "gray_scott", lambda feed, kill, dumps, _: ((time, patterns[0]) for time in dumps))
    example.main(tmp_path / "gray_scott.cdb", views=ViewPlan(frequency=1, width=8, height=8))
    made = Catalog.open(tmp_path / "gray_scott.cdb")
    assert len(made.members) == 24
    assert {member.parameters["time"] for member in made.members} >= {500.0, 1530.0}
