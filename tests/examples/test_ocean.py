"""Veros hooked: heat stays in the water, still water stays still, wind tilts the thermocline, and dumps of a run are members."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from tests.support.environments import PROJECT, in_environment, with_settings

FOLDER = str(PROJECT / "examples/ocean")
MIDDLE = {"K_gm": 1000.0, "A_h": 5e4}
SIMULATE = """
import json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from simulation import simulate
found = []
for field in simulate(json.loads(sys.argv[2]), [0.0, 5.0], [16, 16, 8], 8640.0):
    water = np.isfinite(field.values)
    rows = np.cos(np.deg2rad(field.origin[1] + field.spacing[1] * np.arange(16)))[None, :, None] * water
    middle = field.values[5, 8]  # 137.5 m below the surface, along the equator
    found.append({
        "mean": float((np.where(water, field.values, 0.0) * rows).sum() / rows.sum()),
        "range": [float(np.nanmin(field.values)), float(np.nanmax(field.values))],
        "water": int(water.sum()),
        "tilt": float(middle[np.isfinite(middle)][0] - middle[np.isfinite(middle)][-1]),
        "time": field.time,
    })
print(json.dumps(found))
"""


def simulated(wind: float, folder: Path) -> list[dict[str, Any]]:
    arguments = FOLDER, json.dumps({"wind": wind, **MIDDLE})
    found = json.loads(in_environment("ocean", "python", "-c", SIMULATE, *arguments, folder=folder).splitlines()[-1])
    assert list(folder.iterdir()) == []  # no restart, no diagnostics
    return found


def test_wind_moves_heat_to_the_west_and_makes_none(tmp_path: Path) -> None:
    start, later = simulated(2.0, tmp_path)
    assert [start["time"], later["time"]] == [0.0, 5.0]
    assert start["water"] == later["water"]
    assert 0 < start["water"] < 16 * 16 * 8, "there is land"
    assert later["mean"] == pytest.approx(start["mean"], abs=2e-4)
    assert abs(start["tilt"]) < 1e-4
    assert later["tilt"] > 0.5, "the trade winds pile warm water up in the west"


def test_without_wind_the_water_stays_as_it_is(tmp_path: Path) -> None:
    start, later = simulated(0.0, tmp_path)
    assert abs(later["tilt"]) < 1e-3
    assert later["range"] == pytest.approx(start["range"], abs=0.05)


@pytest.mark.slow
def test_the_scene_renders_dumps_of_a_run_with_holes_for_land(tmp_path: Path) -> None:
    text = (PROJECT / "scenes/ocean.toml").read_text()
    members = text[text.index("[members]") : text.index("[fields]")]
    few = "[members]\ntrain = [{ wind = 1.0, K_gm = 1000.0, A_h = 50000.0, time = [8.0, 9.0] }]\n\n"
    replaced = {members: few, "cells = [32, 32, 16]": "cells = [12, 12, 6]"}
    replaced |= {"frequency = 3\nwidth = 128\nheight = 128\nfill = 1.0": "frequency = 1\nwidth = 16\nheight = 16"}
    path = with_settings("ocean", tmp_path, replaced)
    in_environment("ocean", "insitu", "dataset", str(path), "--runs", str(tmp_path / "runs"), "--workers", "1")
    catalog = tmp_path / "runs/ocean/catalog.cdb"
    assert check(catalog) == []
    first, second = Catalog.open(catalog).members
    assert first.summary().maximum <= 28.5
    assert sum(first.summary().histogram) < 12 * 12 * 6, "land has no values"
    assert list(first.summary().histogram) != list(second.summary().histogram)
