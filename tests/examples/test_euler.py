"""PyClaw hooked: it conserves what it must, stays at rest where it must, and renders members of a scene."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from tests.support.environments import PROJECT, in_environment, with_settings

FOLDER = str(PROJECT / "examples/euler")
AT_REST = dict.fromkeys(("density_1", "density_2", "density_3"), 0.8) | dict.fromkeys(
    ("energy_1", "energy_2", "energy_3"), 2.0
)
APART = {"density_1": 0.5, "energy_1": 1.2, "density_2": 1.0, "energy_2": 2.5, "density_3": 2.0, "energy_3": 5.0}
SOLVE = """
import json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
import simulation
from clawpack import pyclaw
found = {}
for time in (1e-9, 0.4):
    claw = pyclaw.Controller()
    claw.solution, claw.solver = simulation._at_rest(json.loads(sys.argv[2]), 20), simulation._solver()
    claw.tfinal, claw.num_output_times, claw.output_format, claw.verbosity = time, 1, None, 0
    claw.run()
    q = claw.solution.state.q
    found[str(time)] = {
        "sums": [float(q[i].sum()) for i in (0, 4)],
        "fastest": float(np.abs(q[1:4]).max()),
        "steps": claw.solver.status["numsteps"],
    }
print(json.dumps(found))
"""


def solved(parameters: dict[str, float], folder: Path) -> dict[str, dict[str, float]]:
    found = json.loads(in_environment("euler", "python", "-c", SOLVE, FOLDER, json.dumps(parameters), folder=folder))
    assert list(folder.iterdir()) == []  # no log, no frames
    return found


def test_mass_and_energy_stay_in_the_box(tmp_path: Path) -> None:
    found = solved(APART, tmp_path)
    assert found["0.4"]["steps"] >= 3
    assert found["0.4"]["fastest"] > 0.1
    assert found["0.4"]["sums"] == pytest.approx(found["1e-09"]["sums"], rel=1e-12)


def test_one_state_stays_at_rest(tmp_path: Path) -> None:
    assert solved(AT_REST, tmp_path)["0.4"]["fastest"] < 1e-13


@pytest.mark.slow
def test_the_scene_renders_its_members(tmp_path: Path) -> None:
    few = {
        "cells = 64": "cells = 12",
        "train = 30": "train = 2",
        "validation = 3": "validation = 0",
        "test = 5": "test = 1",
    }
    path = with_settings(
        "euler", tmp_path, {**few, "width = 128": "width = 16\nfrequency = 1", "height = 128": "height = 16"}
    )
    in_environment("euler", "insitu", "dataset", str(path), "--runs", str(tmp_path / "runs"), "--workers", "1")
    catalog = tmp_path / "runs/euler/catalog.cdb"
    assert check(catalog) == []
    ranges = {(s.minimum, s.maximum) for s in (m.summary() for m in Catalog.open(catalog).members)}
    assert len(ranges) == 3


@pytest.mark.slow
def test_it_agrees_with_cloverleaf(shared_data: Path) -> None:
    printed = in_environment("euler", "python", f"{FOLDER}/compare.py", "--cells", "32")
    first = next(line for line in printed.splitlines() if line.startswith("| 0 "))
    _, _, _, density, energy, *_ = (cell.strip() for cell in first.split("|"))
    assert float(density) > 0.9
    assert float(energy) > 0.9
