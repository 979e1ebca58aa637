"""Pooled statistics of pilot members."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.vocabulary.appearance import appearance_from_json
from insitu.cli import main
from insitu.ensembles.probe import probe_fields
from render import to_grid


def test_members_weigh_the_same_whatever_their_size() -> None:
    found = probe_fields({"small": np.zeros((5, 5, 5)), "large": np.ones((70, 70, 70))})
    assert found.names == ("small", "large")
    assert found.range == (0.0, 1.0)
    fractions, edges = found.histogram(2, 0.0, 1.0)
    assert fractions.tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert edges.tolist() == [0.0, 0.5, 1.0]
    assert found.values.mean() == pytest.approx(0.5)


def test_quantiles_are_the_fields() -> None:
    field = np.random.default_rng(0).normal(3.0, 2.0, (90, 90, 90))
    found = probe_fields([field])
    for q in (0.01, 0.5, 0.99):
        assert found.quantile(q) == pytest.approx(np.quantile(field, q), abs=0.05)
    assert "3.0" in str(found) or "2.9" in str(found)


def test_holes_are_left_out() -> None:
    field = np.ones((4, 4, 4))
    field[0, 0, 0] = np.nan
    assert probe_fields([field], nan="transparent").range == (1.0, 1.0)
    with pytest.raises(ValueError, match="NaN"):
        probe_fields([field])


def test_holes_of_a_grid_do_not_weigh() -> None:
    values = np.zeros((9, 9, 9))
    values[:, :, 4:] = np.nan  # filled with the nearest value, which is the 1 before them
    values[:, :, 3] = 1.0
    assert probe_fields([to_grid(values, nan="transparent")]).values.mean() == pytest.approx(0.25, abs=0.01)


def test_no_member_is_an_error() -> None:
    with pytest.raises(ValueError, match="no member"):
        probe_fields([])


def test_the_command_prints_a_file_of_appearances(tmp_path: Path) -> None:
    """Files of one name in several folders are as many members, and the whole output is TOML."""
    for number in (1, 2, 3):
        (tmp_path / f"run_{number}").mkdir()
        np.save(tmp_path / f"run_{number}" / "dump.npy", number * np.linspace(0.0, 1.0, 512).reshape(8, 8, 8))
    sources = [str(path) for path in sorted(tmp_path.glob("run_*/dump.npy"))]
    done = CliRunner().invoke(main, ["probe", *sources, "--preview", str(tmp_path / "look.png")])
    assert done.exit_code == 0, done.output
    assert done.output.startswith("# 3 members, values 0 to 3")
    (record,) = tomllib.loads(done.output)["appearance"]
    assert appearance_from_json(record).name == "dvr"
