"""`surrogate train` of a catalog that a hook wrote, and what follows it, as a person types it."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import surrogate.training.run
from catalogs.store.catalog import Catalog
from surrogate.cli import main
from surrogate.explore.facts import facts
from surrogate.explore.run import Run
from surrogate.settings import TrainingSettings
from surrogate.training.loop import Diverged
from tests.support.results import make_catalog, make_scene

SMALL = ("gaussians=20", "--steps", "12")


def call(*words: object) -> str:
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.output


def refused(*words: object) -> str:
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 1, result.output
    assert len(result.output.strip().splitlines()) == 1, result.output
    return result.output


@pytest.fixture
def flow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A catalog flow.cdb of four members in the folder where commands are called."""
    monkeypatch.chdir(tmp_path)
    shutil.move(make_catalog(tmp_path, "flow").path, "flow.cdb")
    return Path("flow.cdb")


@pytest.mark.slow
def test_from_a_catalog_to_the_explorer(flow: Path) -> None:
    said = call("train", flow, *SMALL)
    assert "learns the pictures drawn over p in [0, 1]" in said
    assert "4 members: 2 for training, 1 for validation, 1 for testing\n" in said
    assert "dB over 1 test images: unseen views and parameters" in said
    assert "next: surrogate explore runs/flow" in said
    assert "nothing to do" in call("train", flow, *SMALL)
    assert "nothing to do" in call("train", "runs/flow")
    assert "unseen views, unseen parameters" in call("evaluate", "runs/flow")
    assert "nothing to do" in call("evaluate", "runs/flow")
    assert "report.md" in call("evaluate", "runs/flow", "--records", "kept")
    assert Path("kept/flow/evaluation/0.json").is_file()
    run = Run.open("runs/flow")
    found = facts(run)
    assert [m["split"] for m in found["members"]] == [m.split for m in Catalog.open(flow).members]
    assert (found["title"], found["truth"]) == ("flow", True)
    assert "picture.png" in call("export", "runs/flow", "-p", "p=0.4", "--size", "8x8", "-o", "picture.png")
    assert "gaussians              20" in call("show", "runs/flow")


@pytest.mark.slow
def test_a_catalog_that_moved_is_told_and_found(flow: Path) -> None:
    call("train", flow, *SMALL)
    Path("far").mkdir()
    shutil.move(flow, "far/flow.cdb")
    told = refused("evaluate", "runs/flow")
    assert "if it was moved, `surrogate train NEW/PLACE/flow.cdb -o runs/flow` finds it again" in told
    assert "nothing to do" in call("train", "far/flow.cdb", "-o", "runs/flow")
    assert "unseen views" in call("evaluate", "runs/flow")


@pytest.mark.slow
def test_without_test_members_nothing_is_claimed_of_unseen_parameters(flow: Path) -> None:
    for member in ("test-0", "validation-0"):
        shutil.rmtree(flow / "members" / member)
    said = call("train", flow, *SMALL)
    assert "2 members: 2 for training, 0 for validation; no member tests it, so nothing is known" in said
    assert "unseen views of members that it learnt from; no member tests it" in said
    assert "no member tests it, so nothing is known of unseen parameters\n" in call("evaluate", "runs/flow")
    page = Path("runs/flow/report/report.md").read_text()
    assert "No member was kept aside to test unseen parameters" in page
    assert json.loads(Path("runs/flow/report/report.json").read_text())["trivial_predictors"] == []


@pytest.mark.slow
def test_a_catalog_is_the_source_of_a_scene(flow: Path) -> None:
    scene = Path("mine.toml")
    table = 'name = "mine"\n[source]\nkind = "catalog"\npath = "flow.cdb"\n[training]\n'
    scene.write_text(table + "gaussians = 20\ncanonical_steps = 2\ndeformation_steps = 10\n")
    assert "next: surrogate explore runs/mine" in call("train", scene)
    assert "unseen views" in call("evaluate", scene)
    assert "nothing to do" in call("evaluate", "runs/mine")
    assert [m.name for m in Run.open("runs/mine").members] == [m.name for m in Catalog.open(flow).members]
    scene.write_text(table.replace("[training]", "hold_out = 0.3\n[training]"))
    assert "scene mine.toml: the catalog has 1 test members already" in refused("train", scene)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nowhere.cdb",), "nowhere.cdb does not exist"),
        (("notes.txt",), "notes.txt is neither a scene (a file FILE.toml), a catalog (a folder NAME.cdb) nor"),
        (("empty",), "there is no trained surrogate in empty, nor run.json"),
        (("none.toml",), "scene none.toml does not exist"),
        (("flow.cdb", "--minutes", "0.01"), "--minutes must be a time, at least 0.25, got 0.01"),
        (("flow.cdb", "--minutes", "1", "--steps", "5"), "in minutes or in steps, not in both"),
        (("flow.cdb", "gausians=3"), "did you mean gaussians"),
        (("flow.cdb", "--steps", "5", "--appearance", "iso"), "must be one of the catalog's drawn, got 'iso'"),
        (("flow.cdb", "--hold-out", "1.5"), "must lie between 0 and 1, got 1.5"),
        (("flow.cdb", "--settings", "none.toml"), "none.toml"),
        (("flow.cdb", "--settings", "notes.txt"), "settings notes.txt: "),
        (("flow.cdb", "-o", "notes.txt", "--steps", "5"), "notes.txt"),
        (("scenes/blobs.toml", "--steps", "5", "gaussians=3"), "--steps, KEY=VALUE: for a catalog only"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_what_can_not_be_trained_is_said_in_a_line(flow: Path, words: tuple[str, ...], said: str) -> None:
    Path("notes.txt").write_text("not = a = table")
    Path("empty").mkdir()
    make_scene(Path(), "blobs")
    assert said in refused("train", *words)
    assert not Path("runs/flow/run.json").exists()


def test_a_catalog_is_no_run_yet(flow: Path) -> None:
    assert "`surrogate train flow.cdb` makes a run of it" in refused("evaluate", flow)


def test_a_training_that_diverges_begins_anew(flow: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    train, rates = surrogate.training.run.train, list[float]()

    def diverging(settings: TrainingSettings, *more: Any, **named: Any) -> Any:
        rates.append(settings.latent_rate)
        if len(rates) < 3:
            raise Diverged("training diverged in stage deformation: lower the rates")
        return train(settings, *more, **named)

    monkeypatch.setattr(surrogate.training.run, "train", diverging)
    said = call("train", flow, *SMALL)
    again = "it begins anew with half the rates of the simulation deformation; nothing need be done"
    assert said.count(f"training diverged in stage deformation: {again}") == 2
    assert rates == [0.05, 0.025, 0.0125]
    assert "nothing to do" in call("train", flow)
    rates.clear()
    Path("mine.toml").write_text('name = "mine"\n[source]\nkind = "catalog"\npath = "flow.cdb"\n')
    failed = CliRunner().invoke(main, ["train", "mine.toml"])
    assert failed.exit_code == 1
    assert "lower the rates" in failed.output.splitlines()[-1]


@pytest.mark.parametrize("source", ["flow.cdb", "scenes/blobs.toml"])
def test_an_interrupted_training_says_how_to_resume(flow: Path, monkeypatch: pytest.MonkeyPatch, source: str) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    words, name = ((source, *SMALL), "flow") if source == "flow.cdb" else ((make_scene(Path("."), "blobs"),), "blobs")
    if name == "blobs":
        make_catalog(Path("."), "blobs")
    with monkeypatch.context() as patch:
        patch.setattr(surrogate.training.run, "_trained", interrupted)
        stopped = CliRunner().invoke(main, ["train", *map(str, words)])
    assert stopped.exit_code == 1
    assert stopped.stderr.splitlines()[-1] == (
        "Error: interrupted; what was trained is stored; run the same command to resume"
    )
    for command in (("show",), ("evaluate",), ("explore",), ("export", "-o", "a.png")):
        said = refused(*command[:1], f"runs/{name}", *command[1:])
        assert f"`surrogate train runs/{name}` resumes it where it was interrupted" in said
    assert "dB" in call("train", f"runs/{name}")
