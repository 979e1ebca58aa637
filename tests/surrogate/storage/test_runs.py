import json
import shutil
from pathlib import Path

import pytest

from catalogs.store.catalog import CatalogError
from catalogs.store.splits import Splits
from surrogate.storage.checkpoints import fingerprint
from surrogate.storage.runs import RECORD, RunFolder, RunRecord, path_between
from tests.support.results import SETTINGS_OF_SCENE, make_catalog
from tests.support.surrogates import some_surrogate

SPLITS = Splits({"train-0": "train", "train-1": "train", "validation-0": "test"})


def make_run(root: Path) -> Path:
    """A run of the catalog root/flow/catalog.cdb."""
    catalog = make_catalog(root, "flow")
    folder = root / "results" / "mine"
    folder.mkdir(parents=True)
    mark = fingerprint(SETTINGS_OF_SCENE, catalog.with_splits(SPLITS))
    RunRecord(path_between(folder, catalog.path), SETTINGS_OF_SCENE.to_json(), SPLITS, mark).save(folder)
    return folder


def test_a_run_gives_its_catalog_splits_and_settings(tmp_path: Path) -> None:
    run = RunFolder.open(make_run(tmp_path))
    assert run.name == "mine"
    assert run.settings == SETTINGS_OF_SCENE
    assert {m.name: m.split for m in run.catalog.members} == SPLITS.members
    assert run.record is not None
    assert run.record.catalog == "../../runs/flow/catalog.cdb"
    assert RunRecord.load(run.folder) == run.record


def test_both_may_move_together_and_a_lost_catalog_is_told(tmp_path: Path) -> None:
    make_run(tmp_path / "here")
    shutil.move(tmp_path / "here", tmp_path / "there")
    run = RunFolder.open(tmp_path / "there/results/mine")
    assert (len(run.catalog.members), run.missing) == (3, "")
    shutil.move(tmp_path / "there/runs/flow", tmp_path / "flow")
    lost = RunFolder.open(run.folder)
    with pytest.raises(
        CatalogError, match=r"is not at .*flow/catalog.cdb any more: if it was moved, `surrogate train NEW"
    ):
        _ = lost.catalog


def test_a_catalog_that_lost_members_is_told(tmp_path: Path) -> None:
    folder = make_run(tmp_path)
    shutil.rmtree(tmp_path / "runs/flow/catalog.cdb/members/train-1")
    with pytest.raises(CatalogError, match="lacks members that the run has: train-1"):
        _ = RunFolder.open(folder).catalog


def test_another_catalog_in_the_place_of_the_one_that_was_learnt_is_refused(tmp_path: Path) -> None:
    folder = make_run(tmp_path)
    picture = next((tmp_path / "runs/flow/catalog.cdb/members/train-1").rglob("*.png"))
    picture.write_bytes(picture.read_bytes() + b"other")
    with pytest.raises(CatalogError, match=r"catalog.cdb holds other pictures or members than .*mine was trained on"):
        _ = RunFolder.open(folder).catalog


def test_a_run_of_an_earlier_version_has_its_catalog_beside_it(tmp_path: Path) -> None:
    catalog = make_catalog(tmp_path, "old")
    run = RunFolder.open(tmp_path / "runs/old")
    assert run.catalog.path == catalog.path
    assert [m.split for m in run.catalog.members] == [m.split for m in catalog.members]
    with pytest.raises(FileNotFoundError, match="no trained surrogate yet"):
        _ = run.settings


def test_a_model_alone_is_a_run_without_a_catalog(tmp_path: Path) -> None:
    some_surrogate().save(tmp_path / "surrogate")
    assert "is not at" in RunFolder.open(tmp_path).missing


def test_a_folder_of_other_things_is_none(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="`surrogate train` makes them"):
        RunFolder.open(tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        {"schema": None},
        {"schema": 2},
        {"catalog": 3},
        {"splits": {"members": {"a": "tset"}, "validation_views": 0}},
        {"splits": []},
        {"settings": 7},
        {"more": 1},
    ],
    ids=str,
)
def test_a_damaged_record_is_told(tmp_path: Path, change: dict[str, object]) -> None:
    folder = make_run(tmp_path)
    record = json.loads((folder / RECORD).read_text())
    (folder / RECORD).write_text(json.dumps(record | change))
    with pytest.raises(ValueError, match=r"run.json is damaged"):
        RunFolder.open(folder)


@pytest.mark.parametrize("content", ["", "[]", "{", "null"])
def test_a_file_that_is_no_record_is_told(tmp_path: Path, content: str) -> None:
    folder = make_run(tmp_path)
    (folder / RECORD).write_text(content)
    with pytest.raises(ValueError, match=r"run.json is damaged"):
        RunFolder.open(folder)


def test_a_path_is_relative_where_there_is_something_in_common() -> None:
    assert path_between(Path("/a/runs/x"), Path("/a/flow.cdb")) == "../../flow.cdb"
    assert path_between(Path("/a/runs/x"), Path("/data/flow.cdb")) == "/data/flow.cdb"


@pytest.mark.parametrize("settings", [{"gausians": 3}, {"gaussians": "many"}], ids=str)
def test_settings_that_can_not_be_read_are_told_with_their_place(tmp_path: Path, settings: dict[str, object]) -> None:
    folder = make_run(tmp_path)
    record = json.loads((folder / RECORD).read_text())
    (folder / RECORD).write_text(json.dumps(record | {"settings": settings}))
    with pytest.raises(ValueError, match=r"the settings in .*run\.json can't be read by this version"):
        _ = RunFolder.open(folder).settings
