"""JaxPM hooked: matter stays in the box, weak fluctuations grow as linear theory says, and a scene renders its members."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from tests.support.environments import PROJECT, in_environment, with_settings

FOLDER = str(PROJECT / "examples/cosmology")
GROWTH = """
import json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
import jax_cosmo, simulation
parameters = {"omega_m": 0.14, "h": 0.7, "sigma8": 0.02}
wide = np.sum(np.square(np.meshgrid(*[np.fft.fftfreq(24, 1 / 24)] * 3)), axis=0) <= 4  # that the mesh resolves well
early, late = (np.fft.ifftn(wide * np.fft.fftn(simulation.matter(parameters, 24, 40, z))).real for z in (4.0, 1.0))
expected = jax_cosmo.background.growth_factor(simulation._cosmology(parameters), np.array([0.2, 0.5]))
print(json.dumps({
    "means": [float(early.mean()), float(late.mean())],
    "growth": float(late.std() / early.std()),
    "expected": float(expected[1] / expected[0]),
    "correlation": float(np.corrcoef(early.ravel(), late.ravel())[0, 1]),
}))
"""


@pytest.mark.slow
def test_weak_fluctuations_grow_as_linear_theory_says(tmp_path: Path) -> None:
    grown = json.loads(in_environment("cosmology", "python", "-c", GROWTH, FOLDER, folder=tmp_path).splitlines()[-1])
    assert grown["means"] == pytest.approx([1.0, 1.0], abs=1e-5), "matter stays in the box"
    assert grown["growth"] == pytest.approx(grown["expected"], rel=0.02)
    assert grown["correlation"] > 0.99


@pytest.mark.slow
def test_the_scene_renders_its_members(tmp_path: Path) -> None:
    few = {
        "samples = 64, finer = 2, steps = 20": "samples = 8, finer = 1, steps = 3",
        "train = 24\nvalidation = 4\ntest = 6": "train = 2\nvalidation = 0\ntest = 1",
        "width = 128\nheight = 128": "frequency = 1\nwidth = 16\nheight = 16",
    }
    path = with_settings("cosmology", tmp_path, few)
    in_environment("cosmology", "insitu", "dataset", str(path), "--runs", str(tmp_path / "runs"), "--workers", "1")
    catalog = tmp_path / "runs/cosmology/catalog.cdb"
    assert check(catalog) == []
    members = Catalog.open(catalog).members
    assert sorted(member.split for member in members) == ["test", "train", "train"]
    assert set(members[0].parameters) == {"omega_m", "h", "sigma8"}
