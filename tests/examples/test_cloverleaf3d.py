"""CloverLeaf3D: its input file, its failures, and its solutions beside those that the code's own users stored."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import h5py
import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from tests.support.environments import PROJECT, in_environment, with_settings

FOLDER = PROJECT / "examples/cloverleaf3d"
GAS = {"density_1": 0.5, "energy_1": 1.2, "density_2": 1.0, "energy_2": 2.5, "density_3": 2.0, "energy_3": 5.0}
AT_REST = {name: 0.8 if name.startswith("density") else 2.0 for name in GAS}
SOLVE = """
import json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from simulation import simulate
gas, cells, time = json.loads(sys.argv[2])
np.save(sys.argv[3], [simulate(gas, cells, time, array).values for array in ("density", "energy")])
"""


@pytest.fixture(scope="module")
def simulation() -> ModuleType:
    spec = importlib.util.spec_from_file_location("cloverleaf3d_simulation", FOLDER / "simulation.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def solved(gas: dict[str, float], cells: int, time: float, folder: Path) -> np.ndarray:
    """Density and energy, (2, z, y, x)."""
    output = folder / "solved.npy"
    in_environment(
        "cloverleaf3d", "python", "-c", SOLVE, str(FOLDER), json.dumps([gas, cells, time]), str(output), folder=folder
    )
    assert list(folder.iterdir()) == [output]  # no log, no dump
    return np.load(output)


def test_the_input_file_has_every_state_and_the_grid(simulation: ModuleType) -> None:
    lines = simulation.deck(GAS, 24, 1.6).splitlines()
    assert lines[0] == "*clover"
    assert lines[-1] == "*endclover"
    assert lines[1] == "state 1 density=0.500000000 energy=1.200000000"
    assert lines[3].startswith(
        "state 3 density=2.000000000 energy=5.000000000 geometry=cuboid xmin=6.0 xmax=8.5 ymin=5.0 ymax=7.5"
    )
    assert {"x_cells=24", "y_cells=24", "z_cells=24", "end_time=1.600000000"} <= set(lines)


def test_the_last_dump_is_the_one_of_the_greatest_step(simulation: ModuleType, tmp_path: Path) -> None:
    for step in ("00000", "00009", "00113"):
        (tmp_path / f"clover.00001.{step}.vtk").touch()
    assert simulation.last_dump(tmp_path).name == "clover.00001.00113.vtk"


@pytest.mark.parametrize("script", ["exit 0", "echo 'no such thing' >&2; exit 3"])
def test_a_run_that_does_not_finish_is_an_error(
    script: str, simulation: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = tmp_path / "clover_leaf"
    code.write_text(f"#!/bin/sh\n{script}\n")
    code.chmod(0o755)
    monkeypatch.setattr(simulation, "CODE", code)
    with pytest.raises(RuntimeError, match="did not finish"):
        simulation.run(tmp_path)


def test_mass_stays_in_the_box(tmp_path: Path) -> None:
    start, end = (solved(GAS, 20, time, tmp_path) for time in (0.02, 0.8))
    assert np.abs(end - start).max() > 0.5
    assert end[0].sum() == pytest.approx(start[0].sum(), rel=1e-4)  # dumps have four digits


def test_one_state_stays_at_rest(tmp_path: Path) -> None:
    density, energy = solved(AT_REST, 12, 0.4, tmp_path)
    np.testing.assert_allclose(density, 0.8, rtol=1e-4)
    np.testing.assert_allclose(energy, 2.0, rtol=1e-4)


@pytest.mark.slow
def test_it_is_the_code_of_the_stored_ensemble(shared_data: Path, tmp_path: Path) -> None:
    with h5py.File(shared_data / "cloverleaf3d_energy_64.h5") as file:
        names = [name if isinstance(name, str) else name.decode() for name in file.attrs["names"]]
        gas = dict(zip(names, map(float, file["params"][40]), strict=True))
        expected = file["field"][40].astype(float)
    _, energy = solved(gas, 64, 1.6, tmp_path)
    assert np.linalg.norm(energy - expected) <= 5e-4 * np.linalg.norm(expected)  # float16 and four digits


@pytest.mark.slow
def test_the_scene_renders_its_members(tmp_path: Path) -> None:
    few = {
        "cells = 96": "cells = 12",
        "train = 96": "train = 2",
        "validation = 8": "validation = 0",
        "test = 12": "test = 1",
    }
    sizes = {"width = 256": "width = 16\nfrequency = 1", "height = 256": "height = 16"}
    path = with_settings("cloverleaf-large", tmp_path, few | sizes)
    runs = tmp_path / "runs"
    in_environment("cloverleaf3d", "insitu", "dataset", str(path), "--runs", str(runs), "--workers", "1")
    catalog = runs / "cloverleaf-large/catalog.cdb"
    assert check(catalog) == []
    assert len({m.summary().maximum for m in Catalog.open(catalog).members}) == 3
