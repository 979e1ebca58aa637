"""The benchmark of large catalogs makes whole ones, and what it measures leaves them whole."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from research.benchmarks.stores import scale as catalog_scale


def test_a_catalog_of_the_wanted_size_is_whole(tmp_path: Path) -> None:
    catalog_scale.build(tmp_path / "tiny.cdb", 4)
    assert len(Catalog.open(tmp_path / "tiny.cdb").members) == 4
    assert check(tmp_path / "tiny.cdb") == []


@pytest.mark.parametrize("command", catalog_scale.COMMANDS)
def test_every_command_is_measured_and_leaves_a_whole_catalog(tmp_path: Path, command: str) -> None:
    catalog_scale.build(tmp_path / "tiny.cdb", 3)
    seconds, megabytes = catalog_scale.cost(command, tmp_path / "tiny.cdb")
    assert seconds > 0
    assert megabytes > 0
    assert len(Catalog.open(tmp_path / "tiny.cdb").members) == 3 + (command == "commit")
    assert check(tmp_path / "tiny.cdb") == []


def test_what_a_record_takes_is_said(tmp_path: Path) -> None:
    catalog_scale.build(tmp_path / "tiny.cdb", 30)
    said = CliRunner().invoke(catalog_scale.main, ["--records-of", str(tmp_path / "tiny.cdb")]).output
    assert 0.2 < float(said.removesuffix(" KB a record\n")) < 20.0
