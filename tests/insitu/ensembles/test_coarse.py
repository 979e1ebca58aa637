"""Coarse fields for members that were rendered without: the same as if the hook had stored them, and nothing else changes."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from catalogs.store.catalog import Catalog
from catalogs.store.members import COARSE
from catalogs.tools.check import check
from insitu.cli import main
from tests.support.hooked import tree
from tests.support.looks import LOOK

pytestmark = pytest.mark.usefixtures("prepared_workers")

HOW = ["--spacing", "1", "1", "1", "--bounds", "Re", "0", "4", "--appearance", "look.toml", "--size", "8"]


def ensemble(catalog: str, *arguments: str) -> Result:
    return CliRunner().invoke(main, ["ensemble", "all.csv", "--catalog", catalog, "--workers", "1", *arguments])


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of four files, a catalog of them with coarse fields, and one without."""
    folder = tmp_path_factory.mktemp("coarse")
    before = Path.cwd()
    os.chdir(folder)
    try:
        for i in range(4):
            np.save(f"m{i}.npy", np.random.default_rng(i).random((6, 7, 8)).astype("f4"))
        Path("all.csv").write_text("path,Re\n" + "".join(f"m{i}.npy,{i}\n" for i in range(4)))
        Path("look.toml").write_text(LOOK)
        assert ensemble("with.cdb", *HOW).exit_code == 0
        assert ensemble("without.cdb", *HOW, "--no-coarse-field").exit_code == 0
    finally:
        os.chdir(before)
    return folder


@pytest.fixture
def folder(rendered: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(rendered, tmp_path / "run")
    monkeypatch.chdir(tmp_path / "run")
    return tmp_path / "run"


def coarse_files(catalog: str) -> dict[str, bytes]:
    return {name: data for name, data in tree(Path(catalog)).items() if name.endswith(COARSE)}


@pytest.mark.slow
def test_they_are_those_that_the_hook_stores(folder: Path) -> None:
    before = tree(folder / "without.cdb")
    assert coarse_files("without.cdb") == {}
    again = ensemble("without.cdb")
    assert "4 members of 4 have no coarse field: the same command with --add-coarse-fields adds them" in again.output
    added = ensemble("without.cdb", "--add-coarse-fields")
    assert added.exit_code == 0, added.output
    assert "coarse fields of 4 members added" in added.output
    assert coarse_files("without.cdb") == coarse_files("with.cdb")
    after = tree(folder / "without.cdb")
    assert {n.rpartition("/")[2] for n in after if after[n] != before.get(n)} == {COARSE, "member.json"}
    for name in before:
        if name.endswith("member.json"):
            old, new = json.loads(before[name]), json.loads(after[name])
            assert new["digests"]["files"].pop(COARSE)
            assert {**old, "digest": ""} == {**new, "digest": ""}
    assert check(folder / "without.cdb") == []
    assert "no coarse field" not in ensemble("without.cdb").output


@pytest.mark.slow
def test_what_a_killed_command_left_is_completed(folder: Path) -> None:
    """Two members have files that their records do not know yet."""
    for place in ("members/Re-0.0", "members/Re-2.0"):
        shutil.copy(folder / "with.cdb" / place / COARSE, folder / "without.cdb" / place / COARSE)
    assert check(folder / "without.cdb") == []  # whole and right, if unknown to the record
    added = ensemble("without.cdb", "--add-coarse-fields")
    assert "coarse fields of 4 members added" in added.output
    assert coarse_files("without.cdb") == coarse_files("with.cdb")
    assert "coarse fields of 0 members added" in ensemble("without.cdb", "--add-coarse-fields").output
    assert check(folder / "without.cdb") == []


@pytest.mark.slow
def test_another_field_than_was_rendered_is_refused_and_the_rest_goes_on(folder: Path) -> None:
    np.save("m1.npy", np.random.default_rng(9).random((6, 7, 8)).astype("f4"))
    added = ensemble("without.cdb", "--add-coarse-fields")
    assert added.exit_code == 1
    assert "Re-1.0: its file holds another field than was rendered" in added.output
    assert {Path(name).parent.name for name in coarse_files("without.cdb")} == {"Re-0.0", "Re-2.0", "Re-3.0"}
    assert Catalog.open("without.cdb").missing == ()
    assert check(folder / "without.cdb") == []


@pytest.mark.slow
def test_without_a_catalog_there_is_nothing_to_add_to(folder: Path) -> None:
    added = ensemble("new.cdb", *HOW, "--add-coarse-fields")
    assert added.exit_code == 1
    assert "there is no catalog new.cdb" in added.output
    assert not (folder / "new.cdb").exists()


SCENE = """
name = "flow"
[source]
kind = "simulation"
simulation = "taylor_green"
resolution = 8
time = 0.2
[[parameters]]
name = "Re"
low = 100.0
high = 200.0
[members]
train = [100.0, 200.0]
[views]
frequency = 1
width = 8
height = 8
"""


@pytest.mark.slow
def test_a_scene_is_simulated_again_for_them(tmp_path: Path) -> None:
    def dataset(coarse_field: str, runs: str, *arguments: str) -> Result:
        text = SCENE + f"[render]\nsample_distance = 0.5\ncoarse_field = {coarse_field}\n" + LOOK
        (tmp_path / "flow.toml").write_text(text)
        return CliRunner().invoke(
            main, ["dataset", str(tmp_path / "flow.toml"), "--runs", str(tmp_path / runs), *arguments]
        )

    assert dataset("true", "with").exit_code == 0
    assert "no coarse field" not in dataset("false", "without").output
    again = dataset("true", "without")
    assert "nothing to do" in again.output
    assert "2 members of 2 have no coarse field: `insitu dataset" in again.output
    added = dataset("true", "without", "--add-coarse-fields")
    assert "coarse fields of 2 members added" in added.output, added.output
    here, there = (coarse_files(str(tmp_path / runs / "flow/catalog.cdb")) for runs in ("with", "without"))
    assert here == there != {}


def test_fields_of_images_from_elsewhere_are_not_at_hand(tmp_path: Path) -> None:
    text = 'name = "other"\n[source]\nkind = "nerf"\npath = "x"\nbounds = [[0, 0, 0], [1, 1, 1]]\n'
    (tmp_path / "other.toml").write_text(text)
    said = CliRunner().invoke(main, ["dataset", str(tmp_path / "other.toml"), "--add-coarse-fields"])
    assert said.exit_code == 1
    assert "their fields are not at hand" in said.output


@pytest.mark.parametrize("value", ['"no"', "1"])
def test_an_option_that_is_neither_true_nor_false_is_refused(tmp_path: Path, value: str) -> None:
    (tmp_path / "flow.toml").write_text(SCENE + f"[render]\ncoarse_field = {value}\n" + LOOK)
    said = CliRunner().invoke(main, ["dataset", str(tmp_path / "flow.toml")])
    assert said.exit_code == 1
    assert "coarse_field must be true or false" in said.output
