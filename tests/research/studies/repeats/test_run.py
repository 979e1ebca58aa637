import json
import os
import signal
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from research.studies.progress import StudyProgress
from research.studies.repeats import run as module
from research.studies.repeats.run import STAGE, repeat, score_model
from research.studies.repeats.seeds import Scores, load, scores_path
from surrogate.evaluation.evaluate import evaluate
from surrogate.evaluation.scoring import METRICS, mean
from surrogate.model import Surrogate
from surrogate.provenance import code
from surrogate.settings import TrainingSettings
from surrogate.training.run import train
from tests.research.support.commands import invoked
from tests.support import prepared
from tests.support.blobs import Blobs
from tests.support.varied_blobs import varied_catalog, varied_surrogate

SCENE = TrainingSettings(gaussians=30, canonical_steps=8, deformation_steps=12, validation_interval=10, seed=4)
SMALL = Blobs(count=4, size=16)
MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.5), ("test", 0.7))
VIEW_SPLITS = ("train",) * 4 + ("test",) * 2


@pytest.fixture
def catalog(make_catalog) -> Catalog:
    return make_catalog(SMALL, members=MEMBERS, view_splits=VIEW_SPLITS, name="run/catalog.cdb")


def contents(folder: Path) -> dict[Path, tuple[bytes, int]]:
    return {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.rglob("*") if p.is_file() and p.name != ".lock"}


TIMES = ("seconds", "processor_seconds", "provenance", "settings")


def numbers(scores: Scores) -> dict:
    """All but the times, which one of the settings is about."""
    return {name: value for name, value in asdict(scores).items() if name not in TIMES}


def test_every_seed_is_trained_in_its_folder_and_kept(catalog: Catalog, tmp_path: Path) -> None:
    told: list[Scores] = []
    found = repeat(SCENE, catalog, tmp_path / "run", seeds=3, tell=told.append)
    assert [scores.seed for scores in found] == [4, 5, 6]
    assert told == found
    folders = {4: "surrogate", 5: "seeds/5/surrogate", 6: "seeds/6/surrogate"}
    for scores in found:
        surrogate = Surrogate.load(tmp_path / "run" / folders[scores.seed])
        assert surrogate.training["settings"]["seed"] == scores.seed
        assert surrogate.training["fingerprint"] == scores.fingerprint
        record = json.loads((tmp_path / f"run/seeds/{scores.seed}.json").read_text())
        assert record["key"] | {"seed": scores.seed, "settings": SCENE.to_json()} == record["key"]
        assert record["provenance"]["code"] == code() == surrogate.training["code_version"]
        assert record["provenance"]["processor_seconds"] > record["values"]["processor_seconds"] > 0
    assert len({scores.fingerprint for scores in found}) == 3
    assert {scores.base for scores in found} == {found[0].fingerprint}
    assert len({scores.cells["psnr"]["unseen_views"]["unseen_parameters"] for scores in found}) == 3


def test_scores_are_those_of_a_report_and_of_pictures_compared_by_hand(catalog: Catalog, tmp_path: Path) -> None:
    scores = repeat(SCENE, catalog, tmp_path / "run", seeds=2)[1]
    surrogate = Surrogate.load(tmp_path / "run/seeds/5/surrogate")
    cells = evaluate(surrogate, catalog).cells
    for metric in METRICS:
        assert scores.cells[metric] == {
            v: {p: mean(scored, metric) for p, scored in columns.items()} for v, columns in cells.items()
        }
    decibels, member = [], catalog.member("member-3")
    for view in (4, 5):
        truth = catalog.image(member, "drawn", view, dtype="float32").astype(np.float64)
        picture = surrogate.at(p=0.7).render(member.cameras[view]).astype(np.float64)
        on_white = [image[..., :3] + 1.0 - image[..., 3:] for image in (truth, picture)]
        decibels.append(-10.0 * np.log10(np.mean((on_white[0] - on_white[1].clip(0, 1)) ** 2)))
    assert scores.cells["psnr"]["unseen_views"]["unseen_parameters"] == pytest.approx(np.mean(decibels), abs=1e-3)
    assert scores.cells["images"]["unseen_views"]["unseen_parameters"] == 2


def test_variations_are_scored_as_in_a_report(tmp_path: Path) -> None:
    surrogate = varied_surrogate()
    catalog = varied_catalog(tmp_path / "varied.cdb", surrogate)
    told: list[tuple[str, int, int]] = []
    found = score_model(surrogate, catalog, progress=lambda *counts: told.append(counts))["variations"]
    expected = evaluate(surrogate, catalog).variations
    assert [varied["kind"] for varied in found] == ["isovalue", "transfer_function"]
    for varied, evaluation in zip(found, expected, strict=True):
        for row, columns in evaluation.cells.items():
            for column, scored in columns.items():
                assert varied["images"][row][column] == len(scored)
                for metric in METRICS:
                    assert varied[metric][row][column] == mean(scored, metric)
    assert found[0]["psnr"]["unseen_settings"]["unseen_parameters"] > 50.0  # the truth but for 8 bits
    assert told[-1][0] == STAGE
    assert told[-1][1] == told[-1][2] == max(done for _, done, _ in told)


def test_nothing_is_done_twice(catalog: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = repeat(SCENE, catalog, tmp_path / "run", seeds=2)
    before = contents(tmp_path / "run")
    monkeypatch.setattr(module, "train", None)
    monkeypatch.setattr(module, "score_model", None)
    assert repeat(SCENE, catalog, tmp_path / "run", seeds=2) == first
    assert contents(tmp_path / "run") == before


@pytest.mark.slow
def test_without_a_model_records_answer_unless_other_code_made_them(
    catalog: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = repeat(SCENE, catalog, tmp_path / "run", records=tmp_path / "kept", seeds=2)
    assert sorted(path.name for path in (tmp_path / "kept/seeds").iterdir()) == ["4.json", "5.json"]
    assert repeat(SCENE, catalog, tmp_path / "elsewhere", records=tmp_path / "kept", seeds=2) == first
    assert not (tmp_path / "elsewhere").exists()
    train(SCENE.changed(gaussians=31), catalog, tmp_path / "other" / "surrogate")  # no model of these settings
    monkeypatch.setattr(module, "_code_of", lambda _: "another")
    assert repeat(SCENE, catalog, tmp_path / "other", records=tmp_path / "kept", seeds=2) == first
    monkeypatch.undo()
    monkeypatch.setattr("surrogate.training.run.code", lambda: "later")
    monkeypatch.setattr(module, "code", lambda: "later")
    assert (
        repeat(SCENE, catalog, tmp_path / "run", records=tmp_path / "kept", seeds=2) == first
    )  # these models are of earlier code
    told: list[Scores] = []
    repeat(SCENE, catalog, tmp_path / "elsewhere", records=tmp_path / "kept", seeds=2, tell=told.append)
    assert [(scores.seed, scores.provenance.code) for scores in told] == [(4, "later"), (5, "later")]


def test_a_trained_base_model_is_taken_as_it_is_and_more_seeds_are_added(catalog: Catalog, tmp_path: Path) -> None:
    train(SCENE, catalog, tmp_path / "run/surrogate")
    before = contents(tmp_path / "run/surrogate")
    assert [scores.seed for scores in repeat(SCENE, catalog, tmp_path / "run", seeds=2)] == [4, 5]
    assert contents(tmp_path / "run/surrogate") == before
    told: list[int] = []
    found = repeat(SCENE, catalog, tmp_path / "run", seeds=3, tell=lambda scores: told.append(scores.seed))
    assert [scores.seed for scores in found] == [4, 5, 6]
    assert told == [6]


def test_lost_or_damaged_scores_are_made_again_from_the_model(
    catalog: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = repeat(SCENE, catalog, tmp_path / "run", seeds=2)
    scores_path(tmp_path / "run", 4).unlink()
    scores_path(tmp_path / "run", 5).write_text(scores_path(tmp_path / "run", 5).read_text()[:-9])
    monkeypatch.setattr("surrogate.training.run._trained", None)  # nothing is trained
    again = repeat(SCENE, catalog, tmp_path / "run", seeds=2)
    assert list(map(numbers, again)) == list(map(numbers, first))


def test_other_settings_are_refused_before_anything_is_trained(catalog: Catalog, tmp_path: Path) -> None:
    repeat(SCENE, catalog, tmp_path / "run", seeds=2)
    (tmp_path / "run/surrogate").rename(tmp_path / "run/earlier")
    before = contents(tmp_path / "run")
    with pytest.raises(ValueError, match=r"seeds/5/surrogate hold.*delete or rename"):
        repeat(SCENE.changed(gaussians=31), catalog, tmp_path / "run", seeds=2)
    assert contents(tmp_path / "run") == before


@pytest.mark.parametrize("place", ["seeds", "seeds/5", "seeds/5/surrogate"])
def test_a_file_in_the_place_of_a_folder_is_refused_before_anything_is_trained(
    catalog: Catalog, tmp_path: Path, place: str
) -> None:
    (tmp_path / "run" / place).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / "run" / place).write_text("mine")
    with pytest.raises(ValueError, match=f"run/{place} must be folders.*delete or rename"):
        repeat(SCENE, catalog, tmp_path / "run", seeds=2)
    assert not (tmp_path / "run/surrogate").exists()


def test_scores_of_other_settings_are_not_taken(catalog: Catalog, tmp_path: Path) -> None:
    old = repeat(SCENE, catalog, tmp_path / "run", seeds=3)
    for folder in ("surrogate", "seeds/5/surrogate"):
        (tmp_path / "run" / folder).rename(tmp_path / folder.replace("/", "-"))
    new = repeat(SCENE.changed(gaussians=31), catalog, tmp_path / "run", seeds=2)
    assert [scores.seed for scores in new] == [4, 5]  # what is there of seed 6 is of other settings
    assert not {scores.fingerprint for scores in new} & {scores.fingerprint for scores in old}
    assert load(tmp_path / "run", 6) == old[2]


def test_one_seed_has_no_spread(catalog: Catalog, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least 2"):
        repeat(SCENE, catalog, tmp_path / "run", seeds=1)
    assert not (tmp_path / "run/surrogate").exists()


def test_a_diverged_model_is_named(catalog: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def diverged(*arguments: object, **options: object) -> Surrogate:
        surrogate = train(*arguments, **options)  # type: ignore[arg-type]
        surrogate.gaussians.colors.fill_(float("nan"))
        return surrogate

    monkeypatch.setattr(module, "train", diverged)
    with pytest.raises(ValueError, match=r"seed 4.*diverged"):
        repeat(SCENE, catalog, tmp_path / "run", seeds=2)
    assert not scores_path(tmp_path / "run", 4).exists()


def test_progress_counts_what_had_to_be_done(catalog: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surrogate.training.session.REPORT_SECONDS", 0.0)
    repeat(SCENE, catalog, tmp_path / "run", seeds=2)
    scores_path(tmp_path / "run", 5).unlink()
    seen: list[StudyProgress] = []
    repeat(SCENE, catalog, tmp_path / "run", seeds=3, progress=seen.append)
    assert [(p.name, p.number, p.count) for p in seen] == sorted((p.name, p.number, p.count) for p in seen)
    assert {(p.name, p.number, p.count) for p in seen} == {("seed 5", 1, 2), ("seed 6", 2, 2)}
    scoring = [p for p in seen if "scoring" in p.work]
    total = 2 * 4 + 4 + 2 * 2 + 2  # members x views by cell
    assert f"{total} / {total} images" in scoring[-1].work
    assert scoring[-1].seconds_left == 0.0
    assert any("steps/s" in p.work for p in seen if p.name == "seed 6")
    assert str(scoring[0]).startswith("seed 5 (1 / 2)  scoring")
    assert str(next(p for p in scoring if p.seconds_left is not None)).endswith("in all")


def test_a_killed_run_goes_on_and_ends_as_an_undisturbed_one(catalog: Catalog, tmp_path: Path) -> None:
    whole = repeat(SCENE, catalog, tmp_path / "whole", seeds=2)
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "import surrogate.training.run\n"
        "from catalogs.store.catalog import Catalog\n"
        "from surrogate.storage.checkpoints import Checkpoint\n"
        "from research.studies.repeats.run import repeat\n"
        "from tests.research.studies.repeats.test_run import SCENE\n"
        "save = Checkpoint.save\n"
        "def save_and_die(self, directory):\n"
        "    save(self, directory)\n"
        "    if directory.parent.name == '5' and self.record['done'] and self.record['step']:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "Checkpoint.save = save_and_die\n"
        "from dataclasses import replace\n"
        "repeat(SCENE.changed(checkpoint_seconds=1e-9), Catalog.open(sys.argv[1]), Path(sys.argv[2]), seeds=2)\n"
    )
    status, _, errors = prepared.run(program, catalog.path, tmp_path / "run")
    assert status == -signal.SIGKILL, errors
    assert load(tmp_path / "run", 4) is not None  # what was finished is kept
    assert load(tmp_path / "run", 5) is None
    told: list[int] = []
    resumed = repeat(SCENE, catalog, tmp_path / "run", seeds=2, tell=lambda scores: told.append(scores.seed))
    assert told == [5]
    assert list(map(numbers, resumed)) == list(map(numbers, whole))


def test_an_interruption_while_scoring_loses_only_that(catalog: Catalog, tmp_path: Path) -> None:
    def press(progress: StudyProgress) -> None:
        if progress.name == "seed 5" and "scoring" in progress.work:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        repeat(SCENE, catalog, tmp_path / "run", seeds=2, progress=press)
    assert sorted(path.name for path in (tmp_path / "run/seeds").glob("*")) == ["4.json", "5"]
    before = contents(tmp_path / "run/seeds/5/surrogate")
    assert len(repeat(SCENE, catalog, tmp_path / "run", seeds=2)) == 2
    assert contents(tmp_path / "run/seeds/5/surrogate") == before


TOML = """
name = "run"
[source]
kind = "nerf"
path = "none"
[training]
gaussians = 20
canonical_steps = 6
deformation_steps = 6
"""


@pytest.mark.usefixtures("undrawn")
def test_the_command_prints_and_writes_the_table(catalog: Catalog, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(TOML)

    def call(*arguments: str) -> str:
        result = invoked(arguments[0], scene, "--runs", tmp_path, *arguments[1:])
        assert result.exit_code == 0, result.output
        return result.output

    call("train")
    output = call("repeat", "--seeds", "2")
    assert "seed 1: " in output
    assert "mean ± standard deviation over 2 seeds" in output
    scores = [load(tmp_path / "run", seed) for seed in (0, 1)]
    values = [s.cells["psnr"]["unseen_views"]["unseen_parameters"] for s in scores if s is not None]
    shown = f"{np.mean(values):.2f} ± {np.std(values, ddof=1):.2f}"
    assert shown in output
    assert shown in (tmp_path / "run/seeds/seeds.md").read_text()


def test_bad_numbers_of_seeds_are_refused_in_one_line(catalog: Catalog, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(TOML)
    result = invoked("repeat", scene, "--runs", tmp_path, "--seeds", 0)
    assert result.exit_code == 1
    assert "seeds must be at least 2" in result.output
    assert not (tmp_path / "run/surrogate").exists()
