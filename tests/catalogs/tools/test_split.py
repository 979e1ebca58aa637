"""Shards are whole catalogs that together hold every member once, under an index that clients can read."""

from __future__ import annotations

import csv
import itertools
import os
import shutil
import signal
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from catalogs.cli import main
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.tools.check import check
from catalogs.tools.merge import merge
from catalogs.tools.packing import pack
from catalogs.tools.split import split
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.catalogs.conftest import add_member, make_plan, small_plan
from tests.support.mortal_disk import IN_TURN, MortalDisk, contents, in_child, in_small_process

REYNOLDS = {"d": 110.0, "a": 150.0, "c": 120.0, "b": 190.0, "e": 130.0}
ROWS = 4  # of a member: two appearances, two views


@pytest.fixture
def whole(tmp_path: Path) -> Catalog:
    return filled(tmp_path / "whole.cdb")


def filled(path: Path) -> Catalog:
    catalog = Catalog.create(path, small_plan())
    for number, (name, reynolds) in enumerate(REYNOLDS.items()):
        add_member(catalog, name, reynolds, seed=number)
    catalog.rebuild_table()
    return catalog


def index(path: Path) -> list[dict[str, str]]:
    with (path / "data.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_shards_hold_every_member_once_in_ranges_of_its_parameters(whole: Catalog, tmp_path: Path) -> None:
    shards = split(whole.path, tmp_path / "split.cdb", rows=2 * ROWS)
    assert [shard.members for shard in shards] == [("d", "c"), ("e", "a"), ("b",)]
    rows = index(tmp_path / "split.cdb")
    assert list(rows[0]) == ["shard", "members", "rows", "Re from", "Re to", "Pr from", "Pr to", "FILE"]
    assert [(r["members"], r["rows"], r["Re from"], r["Re to"]) for r in rows] == [
        ("2", "8", "110.0", "120.0"),
        ("2", "8", "130.0", "150.0"),
        ("1", "4", "190.0", "190.0"),
    ]
    assert check(tmp_path / "split.cdb") == []
    for row, shard in zip(rows, shards, strict=True):
        table = tmp_path / "split.cdb" / row["FILE"]
        assert check(table.parent) == []
        assert {line["member"] for line in index(table.parent)} == set(shard.members)
        catalog = Catalog.open(table.parent)
        for name in shard.members:
            assert catalog.member(name).parameters == {"Re": REYNOLDS[name], "Pr": 1.0}
            assert catalog.image_path(name, "dvr", 0).samefile(whole.image_path(name, "dvr", 0))


def test_merged_again_it_is_the_same_catalog(whole: Catalog, tmp_path: Path) -> None:
    shards = split(whole.path, tmp_path / "split.cdb", rows=2 * ROWS)
    merge(tmp_path / "again.cdb", [tmp_path / "split.cdb/shards" / f"{shard.name}.cdb" for shard in shards])
    assert contents(tmp_path / "again.cdb") == contents(whole.path)


def test_packed_catalogs_are_split_too(whole: Catalog, tmp_path: Path) -> None:
    pack(whole.path, tmp_path / "packed.cdb")
    split(tmp_path / "packed.cdb", tmp_path / "split.cdb", rows=2 * ROWS)
    assert check(tmp_path / "split.cdb/shards/shard-1.cdb") == []
    assert Catalog.open(tmp_path / "split.cdb/shards/shard-1.cdb").image("a", "iso", 1).any()
    merge(tmp_path / "again.cdb", sorted((tmp_path / "split.cdb/shards").glob("*.cdb")))
    assert contents(tmp_path / "again.cdb") == contents(tmp_path / "packed.cdb")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=12)
@given(rows=st.integers(1, 6 * ROWS))
def test_no_shard_is_larger_than_asked_but_for_one_member(whole: Catalog, tmp_path: Path, rows: int) -> None:
    shutil.rmtree(tmp_path / "split.cdb", ignore_errors=True)
    shards = split(whole.path, tmp_path / "split.cdb", rows=rows)
    assert sorted(name for shard in shards for name in shard.members) == sorted(REYNOLDS)
    assert all(shard.rows == ROWS * len(shard.members) for shard in shards)
    assert all(shard.rows <= rows or len(shard.members) == 1 for shard in shards)
    pairs = itertools.pairwise(shards)
    assert all(first.rows + ROWS > rows and first.ranges[0][1] <= second.ranges[0][0] for first, second in pairs)


def test_what_can_not_be_split_is_told(whole: Catalog, tmp_path: Path) -> None:
    target = tmp_path / "split.cdb"
    with pytest.raises(CatalogError, match="no members"):
        split(Catalog.create(tmp_path / "empty.cdb", small_plan()).path, target)
    with pytest.raises(CatalogError, match="at least one row"):
        split(whole.path, target, rows=0)
    with pytest.raises(CatalogError, match=r"ends with \.cdb"):
        split(whole.path, tmp_path / "split")
    with pytest.raises(CatalogError, match="a catalog already"):
        split(whole.path, whole.path)
    space = ParameterSpace((Parameter("rows", 0.0, 1.0), Parameter("rows from", 0.0, 1.0)))
    named = Catalog.create(
        tmp_path / "named.cdb", make_plan(space=space, cameras=small_plan().cameras[:1], view_splits=["train"])
    )
    with named.begin_member("m", {"rows": 0.0, "rows from": 1.0}) as writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, whole.image("a", appearance, view))
    assert not target.exists()
    split(named.path, target)  # "rows from" is another label than "rows"
    with pytest.raises(CatalogError, match="not a shard of this catalog"):
        split(whole.path, target, rows=ROWS)


def test_another_split_needs_another_folder(whole: Catalog, tmp_path: Path) -> None:
    split(whole.path, tmp_path / "split.cdb", rows=2 * ROWS)
    before = contents(tmp_path / "split.cdb")
    with pytest.raises(CatalogError, match="choose a new folder"):
        split(whole.path, tmp_path / "split.cdb", rows=3 * ROWS)
    assert contents(tmp_path / "split.cdb") == before
    split(whole.path, tmp_path / "split.cdb", rows=2 * ROWS)
    assert contents(tmp_path / "split.cdb") == before


def test_the_command_says_what_it_did(whole: Catalog, tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["split", str(whole.path), str(tmp_path / "split.cdb"), "--rows", "8"])
    assert result.exit_code == 0, result.output
    assert "split.cdb: 5 members in 3 shards of at most 8 rows" in result.output
    shown = CliRunner().invoke(main, ["show", str(tmp_path / "split.cdb")])
    assert (shown.exit_code, "3 rows" in shown.output) == (0, True)
    assert CliRunner().invoke(main, ["check", str(tmp_path / "split.cdb")]).exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["everything", IN_TURN])
@in_small_process
def test_dead_at_every_operation_the_same_command_completes_it(folder: Path, loss: str) -> None:
    whole = filled(folder / "whole.cdb")
    split(whole.path, folder / "split.cdb", rows=3 * ROWS)
    undisturbed = contents(folder / "split.cdb")
    disk = MortalDisk(-1, "after", folder)
    disk.install()
    split(whole.path, folder / "count.cdb", rows=3 * ROWS)
    disk.remove()
    for step in range(1, disk.count + 1, 3):
        path = folder / f"{step}.cdb"

        def work(path: Path = path, step: int = step) -> None:
            MortalDisk(step, loss, path).install()
            split(whole.path, path, rows=3 * ROWS)

        assert os.WTERMSIG(in_child(work)[1]()) == signal.SIGKILL, f"{step} of {disk.count}"
        if (path / "data.csv").is_file():
            assert check(path) == []
        split(whole.path, path, rows=3 * ROWS)
        assert contents(path) == undisturbed, f"{loss} operation {step} of {disk.count}"
        shutil.rmtree(path)
