"""The examples run, and leave what they say."""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs import Catalog
from catalogs.vocabulary.scene import ViewPlan
from tests.support.mpi import under_mpi

PROJECT = Path(__file__).resolve().parent.parent
FEW = ViewPlan(frequency=1, width=8, height=8)


def example_named(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(name, PROJECT / f"examples/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    return example


@pytest.mark.slow
def test_gray_scott(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example = example_named("gray_scott")
    patterns = {time: v.copy() for time, v in example.gray_scott(0.03, 0.056, (0, 40), 16)}
    assert float(patterns[0].max()) == 0.25
    assert np.isfinite(patterns[40]).all()
    # A short run in place of each: the times are those that a member says.
    monkeypatch.setattr(example, "gray_scott", lambda feed, kill, dumps, _: ((time, patterns[0]) for time in dumps))
    example.main(tmp_path / "gray_scott.cdb", views=FEW)
    made = Catalog.open(tmp_path / "gray_scott.cdb")
    assert len(made.members) == 24
    assert {member.parameters["time"] for member in made.members} >= {500.0, 1530.0}


@pytest.mark.slow
def test_stirred_dye(tmp_path: Path) -> None:
    example = example_named("stirred_dye")
    still, moved = (dict(example.stirred(strength, (0.3, 0.9), 16)) for strength in (0.0, 2.0))
    assert list(still) == [0.3, 0.9]
    np.testing.assert_allclose(still[0.9], still[0.3], atol=1e-3)
    assert float(np.abs(moved[0.9] - still[0.9]).max()) > 0.3
    assert float(moved[0.9].sum()) == pytest.approx(float(still[0.9].sum()), rel=0.3)  # the flow has no sources
    example.main(tmp_path / "stirred_dye.cdb", size=8, views=FEW)
    made = Catalog.open(tmp_path / "stirred_dye.cdb")
    assert len(made.members) == 35
    assert {member.parameters["time"] for member in made.members} == {0.3, 0.4, 0.5, 0.9, 1.5, 1.6, 2.1, 2.8}


@pytest.mark.slow
def test_ranks(tmp_path: Path) -> None:
    program = (
        "import sys, pathlib, runpy; from catalogs.vocabulary.scene import ViewPlan;"
        "main = runpy.run_path(sys.argv[1])['main'];"
        "main(pathlib.Path(sys.argv[2]), size=12, views=ViewPlan(frequency=1, width=8, height=8))"
    )
    example = PROJECT / "examples/ranks.py"
    done = under_mpi("mpi4py", 3, "-c", program, str(example), str(tmp_path / "heat.cdb"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("20 members rendered into ")
    made = Catalog.open(tmp_path / "heat.cdb")
    assert {m.parameters["time"] for m in made.members} == {0.0, 20.0, 40.0, 60.0}
    peaks = [next(iter(m.summaries().values())).maximum for m in made.members if m.parameters["diffusivity"] == 1.0]
    assert peaks == sorted(peaks, reverse=True)
