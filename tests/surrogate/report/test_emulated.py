"""Reports say which representation draws, and how well numbers of emulated fields are known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from catalogs.vocabulary.variations.field import field_variation
from surrogate.cli import main
from surrogate.evaluation.evaluate import evaluate
from surrogate.evaluation.scoring import mean
from surrogate.model import Surrogate
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS
from surrogate.report.emulated import numbers_section, representations_section
from surrogate.report.report import write_report
from surrogate.settings import TrainingSettings
from surrogate.training.run import train
from tests.support.field_catalogs import field, rendered
from tests.support.hooked import FUNCTION

SETTINGS = TrainingSettings(gaussians=60, canonical_steps=4, deformation_steps=8, visualization_steps=6)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Surrogate, Catalog, Path]:
    folder = tmp_path_factory.mktemp("run")
    catalog = rendered(folder / "catalog.cdb")
    return train(SETTINGS, catalog, folder / "surrogate"), catalog, folder


@pytest.fixture(scope="module")
def report(run: tuple[Surrogate, Catalog, Path]) -> tuple[dict[str, Any], str]:
    _, _, folder = run
    result = CliRunner().invoke(main, ["evaluate", str(folder)])
    assert result.exit_code == 0, result.output
    assert "values of the field, unseen parameters: relative error " in result.output
    text = (folder / "report" / "report.md").read_text()
    return json.loads((folder / "report" / "report.json").read_text()), text


@pytest.mark.slow
def test_all_representations_stand_side_by_side(
    run: tuple[Surrogate, Catalog, Path], report: tuple[dict[str, Any], str]
) -> None:
    surrogate, (record, text) = run[0], report
    drawn = record["representations"]
    assert drawn["drawn_by"]["view"] == FIELD
    assert set(drawn["psnr"]) == {"view", "isovalue", "transfer_function"}
    for kind, by_name in drawn["psnr"].items():
        assert set(by_name) == {GAUSSIANS, FIELD, BOTH}
        assert {name: of["validation"] for name, of in by_name.items()} == surrogate.scores.psnr[kind]
        assert all(of["test"] is not None for of in by_name.values()), kind
    assert drawn["psnr"]["view"][FIELD]["test"] == record["psnr"]["unseen_views"]["unseen_parameters"]
    named = {entry["representation"]: entry for entry in record["trivial_predictors"] if entry["representation"]}
    assert set(named) == {GAUSSIANS, BOTH}
    test = named[GAUSSIANS]["psnr"]["unseen_views"]["unseen_parameters"]
    assert drawn["psnr"]["view"][GAUSSIANS]["test"] == test
    assert drawn["megabytes"] == surrogate.sizes
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| views | ")]
    shown = [row for row in rows if len(row) == 6]
    assert [row[1] for row in shown] == [
        "by its Gaussians",
        "from its emulated field",
        "as the mean image of Gaussians and field",
    ]
    assert [row[1] for row in shown if row[2].startswith("**")] == ["from its emulated field"]
    assert "Views are drawn from its emulated field: on validation images that is " in text
    assert "**surrogate**, drawn from its emulated field, " in text
    assert "| the Gaussians (" in text


@pytest.mark.slow
def test_numbers_have_errors_and_intervals(report: tuple[dict[str, Any], str]) -> None:
    record, text = report
    [numbers] = record["numbers"]
    assert set(numbers["errors"]) == {"values", "minimum", "maximum", "mean", "share_above"}
    assert {error["members"] for error in numbers["errors"].values()} == {1}
    assert "## Numbers" in text
    assert "| the field | values at 4,000 places | " in text


@pytest.mark.slow
def test_what_was_asked_for_is_said(run: tuple[Surrogate, Catalog, Path], tmp_path: Path) -> None:
    surrogate, catalog, _ = run
    by_gaussians = surrogate.using(GAUSSIANS)
    evaluation = evaluate(by_gaussians, catalog)
    record = write_report(tmp_path / "report", "a", by_gaussians, catalog, evaluation)
    assert record["representations"]["drawn_by"]["view"] == GAUSSIANS
    by_name = {baseline.representation: baseline for baseline in evaluation.baselines if baseline.representation}
    assert set(by_name) == {FIELD, BOTH}
    assert by_name[FIELD].name.startswith("the emulated field, drawn (0.0")
    drawn = record["representations"]["psnr"]["view"]
    assert drawn[FIELD]["test"] == mean(by_name[FIELD].scores["unseen_views"], "psnr")
    assert "Views are drawn by its Gaussians, as was asked for." in (tmp_path / "report" / "report.md").read_text()


def test_without_an_emulator_there_is_nothing_to_say() -> None:
    assert representations_section({}) == representations_section({"representations": None}) == []
    assert numbers_section({}) == numbers_section({"numbers": []}) == []


def test_scores_of_left_out_members_are_called_so() -> None:
    scores = {
        "psnr": {"view": {FIELD: {"validation": 40.0, "test": None}}},
        "drawn_by": {"view": FIELD},
        "named": "",
        "beside_fields": [],
        "megabytes": {FIELD: 1.0},
        "milliseconds": {},
    }
    for left_out, title in ((True, "PSNR, left-out members"), (False, "PSNR, validation")):
        text = "\n".join(representations_section({"representations": {**scores, "left_out": left_out}}))
        assert f"| {title} |" in text


@pytest.mark.slow
def test_a_field_alone_is_reported(run: tuple[Surrogate, Catalog, Path], tmp_path: Path) -> None:
    catalog = run[1]
    alone = train(SETTINGS, catalog, tmp_path / "surrogate", only_field=True)
    record = write_report(tmp_path / "report", "a", alone, catalog, evaluate(alone, catalog))
    assert record["representations"]["drawn_by"]["view"] == FIELD
    assert "from its emulated field: nothing else was trained." in (tmp_path / "report" / "report.md").read_text()


@pytest.mark.slow
def test_other_fields_are_compared_where_all_are_trained(tmp_path: Path) -> None:
    looks = [VolumeRendering("dvr", FUNCTION, field="q"), VolumeRendering("speed", FUNCTION, field="speed")]
    variation = field_variation("dvr", appearances=["speed"])
    options: dict[str, Any] = {"appearances": looks, "fields": {"q": "1/s", "speed": "m/s"}, "variations": [variation]}
    views = ViewPlan(frequency=1, width=16, height=16)
    with insitu.Session(tmp_path / "a.cdb", space={"p": (0.0, 1.0)}, views=views, **options) as session:
        for p, split in ((0.0, "train"), (0.3, "train"), (0.7, "train"), (1.0, "train"), (0.4, "test")):
            fields = {"q": field(p), "speed": 0.5 * field(1.0 - p)}
            session.render_member(fields, {"p": p}, spacing=(0.1,) * 3, split=split)
    catalog = Catalog.open(tmp_path / "a.cdb")
    surrogate = train(SETTINGS, catalog, tmp_path / "surrogate")
    record = write_report(tmp_path / "report", "a", surrogate, catalog, evaluate(surrogate, catalog))
    by_name = record["representations"]["psnr"]["field"]
    assert {name for name, of in by_name.items() if of["test"] is not None} == {GAUSSIANS, FIELD, BOTH}
    assert [(numbers["name"], numbers["unit"]) for numbers in record["numbers"]] == [("q", "1/s"), ("speed", "m/s")]
    assert "| speed (m/s) | mean | " in (tmp_path / "report" / "report.md").read_text()
