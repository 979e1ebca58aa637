"""`insitu dataset --engine` from the command line to the catalog."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from insitu.cli import main
from tests.support.local_cluster import PROJECT, local_cluster

SCENE = str(PROJECT / "scenes" / "tiny.toml")


@pytest.mark.slow
def test_a_scene_is_rendered_by_a_cluster_and_then_left_alone(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install gs-surrogate[dask]")
    with local_cluster(tmp_path, workers=2) as workers:
        command = ["dataset", SCENE, "--runs", str(tmp_path / "runs"), "--engine", workers.address]
        made, again = (CliRunner().invoke(main, command, catch_exceptions=False) for _ in range(2))
    assert made.exit_code == 0, made.output
    assert "nothing to do" in again.output
    path = tmp_path / "runs" / "tiny" / "catalog.cdb"
    assert len(Catalog.open(path).members) > 1
    assert check(path) == []


@pytest.mark.parametrize(
    ("options", "told"),
    [(["--engine", "slurm"], "takes dask://HOST:PORT"), (["--engine", "dask://h:1", "--workers", "2"], "give one of")],
)
def test_what_can_not_be_is_told_before_anything_is_written(tmp_path: Path, options: list[str], told: str) -> None:
    result = CliRunner().invoke(main, ["dataset", SCENE, "--runs", str(tmp_path / "runs"), *options])
    assert result.exit_code != 0
    assert told in result.output
    assert list(tmp_path.iterdir()) == []
