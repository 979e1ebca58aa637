"""Damaged files among others that hold several states each: they lose their own members only, and are named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from catalogs.store.catalog import Catalog
from insitu.cli import main
from tests.support.looks import LOOK
from tests.support.run_files import write

pytestmark = pytest.mark.usefixtures("prepared_workers")


def ensemble(folder: Path, *sources: str) -> Result:
    (folder / "look.toml").write_text(LOOK)
    options = ["--catalog", "c.cdb", "--size", "16", "--workers", "1", "--appearance", "look.toml"]
    return CliRunner().invoke(main, ["ensemble", *sources, *options])


def cut(path: Path, share: float = 0.5) -> bytes:
    """Cuts a file short; returns what it was."""
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    return whole


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "damaged"), [("nc", 100), ("h5", 300)])
def test_of_a_damaged_run_the_others_are_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, damaged: int
) -> None:
    pytest.importorskip("xarray")
    monkeypatch.chdir(tmp_path)
    for run in (100, 200, 300):
        write(Path(f"run_{run}.{suffix}"), run)
    whole = cut(Path(f"run_{damaged}.{suffix}"))
    done = ensemble(tmp_path, f"run_{{Re}}.{suffix}")
    assert done.exit_code == 1
    assert "1 member failed; the same command tries it again" in done.output
    assert f"Re-{damaged}.0: its states can't be read: run_{damaged}.{suffix} is not readable" in done.output
    catalog = Catalog.open("c.cdb")
    assert len(catalog.members) == 6
    assert [(m.name, dict(m.parameters)) for m in catalog.missing] == [(f"Re-{damaged}.0", {"Re": damaged})]
    assert ensemble(tmp_path, f"run_{{Re}}.{suffix}").exit_code == 1

    Path(f"run_{damaged}.{suffix}").write_bytes(whole)
    done = ensemble(tmp_path, f"run_{{Re}}.{suffix}")
    assert done.exit_code == 0, done.output
    assert len((catalog := Catalog.open("c.cdb")).members) == 9
    assert not catalog.missing


@pytest.mark.slow
def test_a_damaged_list_of_times_is_named_after_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pyvista = pytest.importorskip("pyvista")
    monkeypatch.chdir(tmp_path)
    for time in range(6):
        grid = pyvista.ImageData(dimensions=(5, 6, 7))
        grid["q"] = np.random.default_rng(time).random(grid.n_points)
        grid.save(f"{time}.vti")
    for number in range(3):
        rows = [{"name": f"{time}.vti", "time": time} for time in (2 * number, 2 * number + 1)]
        Path(f"run{number}.vti.series").write_text(json.dumps({"files": rows}))
    cut(Path("run1.vti.series"))
    done = ensemble(tmp_path, *(f"run{number}.vti.series" for number in range(3)))
    assert done.exit_code == 1
    assert [m.name for m in Catalog.open("c.cdb").missing] == ["run1.vti"]
    assert len(Catalog.open("c.cdb").members) == 4
