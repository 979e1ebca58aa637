import json
import shutil
import time
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import CHECKPOINT
from surrogate.storage.runs import RECORD, RunFolder, RunRecord
from surrogate.training.begin import TrainingOptions, begin, calmer, read_settings
from surrogate.training.budget import Budget
from tests.support.results import MEMBERS, make_catalog

STEPS = TrainingOptions(Budget(steps=40))


@pytest.fixture
def catalog(tmp_path: Path) -> Path:
    return make_catalog(tmp_path, "flow").path


def test_a_run_is_begun_and_found_again(catalog: Path, tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    asked = TrainingOptions(Budget(steps=40), settings={"seed": 3, "carried": "colors", "latent_rate": 1e-3})
    run = begin(catalog, folder, asked)
    assert run.settings.seed == 3
    assert (run.settings.canonical_steps, run.settings.deformation_steps) == (2, 38)
    assert {m.name: m.split for m in run.catalog.members} == {name: name.split("-")[0] for name in MEMBERS}
    before = (folder / RECORD).read_bytes()
    for again in (asked, TrainingOptions(), TrainingOptions(settings={"seed": 3}), TrainingOptions(Budget(steps=40))):
        assert begin(catalog, folder, again).settings == run.settings
    assert (folder / RECORD).read_bytes() == before
    assert begin(catalog, tmp_path / "other", asked).settings == run.settings


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (TrainingOptions(Budget(steps=41)), "was begun with --steps 40, not --steps 41"),
        (TrainingOptions(Budget(minutes=1.0)), "no --minutes, not --minutes 1"),
        (TrainingOptions(hold_out=0.2), "no --hold-out, not --hold-out 0.2"),
        (TrainingOptions(settings={"gaussians": 7, "seed": 1}), "not 7; seed=0, not 1"),
    ],
    ids=["steps", "minutes", "hold-out", "settings"],
)
def test_a_run_that_was_begun_otherwise_stays(catalog: Path, tmp_path: Path, asked: TrainingOptions, said: str) -> None:
    begin(catalog, tmp_path / "mine", STEPS)
    before = (tmp_path / "mine" / RECORD).read_bytes()
    with pytest.raises(ValueError, match=said):
        begin(catalog, tmp_path / "mine", asked)
    assert (tmp_path / "mine" / RECORD).read_bytes() == before


def test_a_catalog_that_moved_is_found_again_and_another_one_is_not_taken_for_it(catalog: Path, tmp_path: Path) -> None:
    begin(catalog, tmp_path / "mine", STEPS)
    moved = tmp_path / "archive" / "flow.cdb"
    shutil.move(catalog, moved)
    assert begin(moved, tmp_path / "mine", TrainingOptions()).catalog_path == moved
    record = RunRecord.load(tmp_path / "mine")
    assert record is not None
    assert record.catalog == "../archive/flow.cdb"
    other = make_catalog(tmp_path / "else", "flow").path
    (other / "members/train-0/drawn/000.png").write_bytes(b"other bytes")
    with pytest.raises(ValueError, match=r"is a run of .*archive/flow.cdb, not of .*else"):
        begin(other, tmp_path / "mine", TrainingOptions())


def test_members_that_come_later_do_not_belong_to_the_run(catalog: Path, tmp_path: Path) -> None:
    begin(catalog, tmp_path / "mine", STEPS)
    grown = Catalog.open(catalog)
    with grown.begin_member("late", {"p": 0.3}) as writer:
        for view, _ in enumerate(grown.plan.cameras):
            writer.write_image("drawn", view, grown.image("train-0", "drawn", view))
    assert {m.name for m in begin(catalog, tmp_path / "mine", STEPS).catalog.members} == set(MEMBERS)


@pytest.mark.parametrize("there", ["catalog.cdb", "surrogate/model.json", f"surrogate/{CHECKPOINT}"])
def test_the_results_of_a_scene_are_left_alone(catalog: Path, tmp_path: Path, there: str) -> None:
    (tmp_path / "mine" / there).parent.mkdir(parents=True)
    (tmp_path / "mine" / there).write_text("")
    with pytest.raises(ValueError, match="choose another folder with -o"):
        begin(catalog, tmp_path / "mine", STEPS)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (TrainingOptions(Budget(steps=40), hold_out=0.2), "1 test members already"),
        (
            TrainingOptions(Budget(steps=40), settings={"appearance": "iso"}),
            r"one of the catalog's drawn, got 'iso'",
        ),
        (TrainingOptions(Budget(steps=40), settings={"canonical_steps": 5}), "leave out canonical_steps"),
        (
            TrainingOptions(Budget(steps=40), settings={"initialization": "in-situ"}),
            "no training member .* has sampled points",
        ),
        (TrainingOptions(Budget(minutes=0.25), settings={"gaussians": 50}), "too short here"),
    ],
    ids=["hold-out", "appearance", "steps", "points", "time"],
)
def test_what_can_not_be_had_leaves_nothing(catalog: Path, tmp_path: Path, asked: TrainingOptions, said: str) -> None:
    begun = time.perf_counter()
    with pytest.raises(ValueError, match=said):
        begin(catalog, tmp_path / "mine", asked, elapsed=lambda: 14.0 + time.perf_counter() - begun)
    assert not (tmp_path / "mine").exists()


def test_settings_that_say_the_steps_need_no_budget(catalog: Path, tmp_path: Path) -> None:
    settings = {"canonical_steps": 5, "deformation_steps": 20}
    run = begin(catalog, tmp_path / "mine", TrainingOptions(settings=settings))
    assert run.settings == TrainingSettings.from_table(settings)
    assert json.loads((tmp_path / "mine" / RECORD).read_text())["asked"]["minutes"] is None
    assert TrainingOptions().whole_budget == Budget(minutes=10.0)


def test_a_damaged_catalog_is_told(catalog: Path, tmp_path: Path) -> None:
    (catalog / "catalog.json").write_text("{")
    with pytest.raises(ValueError, match=r"catalog.json is damaged"):
        begin(catalog, tmp_path / "mine", STEPS)


@pytest.mark.parametrize(
    ("text", "found"),
    [("gaussians = 7", {"gaussians": 7}), ("name = 'x'\n[training]\ngaussians = 7", {"gaussians": 7}), ("", {})],
)
def test_settings_are_read_from_a_file(tmp_path: Path, text: str, found: dict[str, int]) -> None:
    (tmp_path / "s.toml").write_text(text)
    assert read_settings(tmp_path / "s.toml") == found


@pytest.mark.parametrize("text", ["gaussians = ", "gausians = 7", "training = 3", "gaussians = 'many'"])
def test_a_file_of_other_things_is_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(ValueError, match=r"settings .*s\.toml: "):
        read_settings(tmp_path / "s.toml")


def test_a_training_that_diverged_begins_anew_with_lower_rates_but_not_for_ever(catalog: Path, tmp_path: Path) -> None:
    run = begin(catalog, tmp_path / "mine", STEPS)
    (run.model).mkdir()
    (run.model / CHECKPOINT).write_text("of the first")
    before = run.settings
    for factor in (0.5, 0.25, 0.125):
        found = calmer(run)
        assert found is not None
        run = found
        assert run.settings.latent_rate == factor * before.latent_rate
        assert run.settings.embedding_rate == factor * before.embedding_rate
        assert not (run.model / CHECKPOINT).exists()
        assert begin(catalog, tmp_path / "mine", STEPS).settings == run.settings
    assert calmer(run) is None
    assert calmer(RunFolder(catalog.parent)) is None
