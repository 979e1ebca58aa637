"""Evaluation and report of visualization parameters on images that are known: a surrogate's own, or those of another one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from surrogate.cli import main
from surrogate.deformation import BilinearDeformation, ValuesDeformation
from surrogate.evaluation.cases import PARAMETERS, SETTINGS
from surrogate.evaluation.evaluate import AT_NEAREST, Evaluation, VariedEvaluation, evaluate
from surrogate.evaluation.perceptual import PerceptualMetrics
from surrogate.evaluation.scoring import METRICS
from surrogate.model import Surrogate
from surrogate.report.report import is_current, write_report
from tests.support.tables import squared_error, tables
from tests.support.varied_blobs import (
    FUNCTIONS,
    ISOVALUE,
    MEMBERS,
    UNSEEN,
    varied,
    varied_catalog,
    varied_surrogate,
)

WHITE = (1.0, 1.0, 1.0)
KINDS = {"isovalue": 0, "transfer_function": 1}
TEST_VIEWS = (3, 4)


@pytest.fixture(scope="module")
def perfect(tmp_path_factory: pytest.TempPathFactory) -> tuple[Surrogate, Catalog, Evaluation]:
    """On opaque images, in which 8 bits leave more than the 60 dB that are counted; with alpha they leave less."""
    surrogate = varied_surrogate()
    folder = tmp_path_factory.mktemp("perfect") / "blobs"
    catalog = varied_catalog(folder / "catalog.cdb", surrogate, background=WHITE)
    return surrogate, catalog, evaluate(surrogate, catalog)


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> tuple[Surrogate, Catalog, Evaluation]:
    """A surrogate that knows all there is but for F_vis, which is weaker than the truth's; images with alpha."""
    truth = varied_surrogate()
    catalog = varied_catalog(tmp_path_factory.mktemp("wrong") / "a.cdb", truth)
    surfaces, functions = truth.visualizations
    assert isinstance(surfaces.deformation, BilinearDeformation)
    assert isinstance(functions.deformation, ValuesDeformation)
    weaker = (
        replace(surfaces, deformation=replace(surfaces.deformation, units=0.6 * surfaces.deformation.units)),
        replace(functions, deformation=replace(functions.deformation, weights=0.6 * functions.deformation.weights)),
    )
    surrogate = replace(truth, visualizations=weaker)
    return surrogate, catalog, evaluate(surrogate, catalog)


def test_the_surrogate_that_drew_the_images_is_perfect_on_all_of_them(perfect) -> None:
    _, _, evaluation = perfect
    assert [v.variation for v in evaluation.variations] == [ISOVALUE, FUNCTIONS]
    for varied_evaluation in evaluation.variations:
        for scored in varied_evaluation.scored:
            assert scored.score.psnr == 60.0
            assert scored.score.squared_error < 1e-6
    assert {s.score.psnr for row in evaluation.cells.values() for group in row.values() for s in group} == {60.0}


@pytest.mark.parametrize("kind", KINDS)
def test_cells_hold_the_unseen_views_of_their_members_and_settings(perfect, kind: str) -> None:
    varied_evaluation = perfect[2].variations[KINDS[kind]]
    for row, setting_splits in SETTINGS.items():
        for column, member_splits in PARAMETERS.items():
            member = f"{member_splits[0]}-0"
            names = [n for n in varied_evaluation.variation.named(*setting_splits) if n in MEMBERS[member][1]]
            found = [
                (s.target.member.name, s.target.appearance, s.target.view) for s in varied_evaluation.cells[row][column]
            ]
            assert found == [(member, name, view) for name in names for view in TEST_VIEWS]
    named = varied_evaluation.variation.named("validation")
    watched = [(s.target.member.name, s.target.appearance, s.target.view) for s in varied_evaluation.validation]
    assert watched == [("validation-0", name, view) for name in named for view in (0, 1, 2)]


@pytest.mark.parametrize("kind", KINDS)
def test_scores_are_those_of_the_pictures_at_the_setting(wrong, kind: str) -> None:
    surrogate, catalog, evaluation = wrong
    varied_evaluation = evaluation.variations[KINDS[kind]]
    for row in SETTINGS:
        for column in PARAMETERS:
            errors = []
            for scored in varied_evaluation.cells[row][column]:
                case = scored.target
                truth = catalog.image(case.member, case.appearance, case.view)
                picture = surrogate.at(p=case.member.parameters["p"], **varied(case.appearance)).render(case.camera)
                errors.append(squared_error(truth, picture))
                assert scored.score.psnr == pytest.approx(min(60.0, -10 * np.log10(errors[-1])), abs=1e-3)
                assert scored.score.covered == pytest.approx((truth[..., 3] > 1).mean())
            assert np.mean(errors) > 1e-5  # it is wrong indeed
            record = summary(evaluation, surrogate)["variations"][KINDS[kind]]
            assert record["psnr_of_mean_error"][row][column] == pytest.approx(-10 * np.log10(np.mean(errors)), abs=1e-3)


# What each member shows of the trained settings, and what rules make of it for an unseen one, worked out by hand.
MIXTURES = {
    ("nearest trained setting", "train-0", "iso=2.5"): {"iso=2": 1.0},
    ("nearest trained setting", "test-0", "iso=2.5"): {"iso=1": 1.0},  # at -1, -1/6 and 1
    ("nearest trained setting", "test-0", "iso=8"): {"iso=16": 1.0},
    ("linear interpolation of isovalues", "train-0", "iso=2.5"): {"iso=2": 0.75, "iso=4": 0.25},
    ("linear interpolation of isovalues", "test-0", "iso=2.5"): {"iso=1": 7 / 12, "iso=16": 5 / 12},
    ("nearest trained setting", "train-0", "tf-test-0"): {"tf-train-0": 1.0},
    ("nearest trained setting", "train-0", "tf-test-1"): {"dvr": 1.0},
    ("nearest trained setting", "validation-0", "tf-validation-0"): {"dvr": 1.0},
    ("inverse distances to the 4 nearest settings", "test-0", "tf-test-0"): {
        "tf-train-0": 0.125**-0.5,
        "tf-train-1": 1.125**-0.5,
        "dvr": 0.625**-0.5,
    },
}


@pytest.mark.parametrize(("name", "member", "wanted"), MIXTURES)
def test_trivial_predictors_mix_what_the_member_shows(wrong, name: str, member: str, wanted: str) -> None:
    _, catalog, evaluation = wrong
    mixture = MIXTURES[name, member, wanted]
    baselines = evaluation.variations["tf" in wanted].baselines
    column = {"train-0": "seen_parameters", "test-0": "unseen_parameters"}.get(member, "validation")
    scores = next(b for b in baselines if b.name == name).scores[column]
    found = [s for s in scores if (s.target.member.name, s.target.appearance) == (member, wanted)]
    assert found
    for scored in found:
        pictures = {n: catalog.image(member, n, scored.target.view) / 255.0 for n in mixture}
        mixed = sum(w * pictures[n] for n, w in mixture.items()) / sum(mixture.values())
        truth = catalog.image(member, wanted, scored.target.view)
        expected = -10 * np.log10(squared_error(truth, np.asarray(mixed)))
        assert scored.score.psnr == pytest.approx(expected, abs=1e-3)


def test_the_surrogate_is_asked_at_the_nearest_setting_of_all_that_it_learnt(wrong) -> None:
    surrogate, catalog, evaluation = wrong
    nearest = {"iso=2.5": "iso=2", "iso=8": "iso=4", "tf-test-0": "tf-train-0", "tf-test-1": "dvr"}
    for varied_evaluation in evaluation.variations:
        baseline = next(b for b in varied_evaluation.baselines if b.name == AT_NEAREST)
        assert list(baseline.scores) == ["unseen_parameters"]
        assert len(baseline.scores["unseen_parameters"]) == 4
        for scored in baseline.scores["unseen_parameters"]:
            case = scored.target
            picture = surrogate.at(p=0.5, **varied(nearest[case.appearance])).render(case.camera)
            expected = squared_error(catalog.image(case.member, case.appearance, case.view), picture)
            assert scored.score.psnr == pytest.approx(min(60.0, -10 * np.log10(expected)), abs=1e-3)


def test_members_that_show_a_part_are_said_to(wrong) -> None:
    surrogate, _, evaluation = wrong
    for record, (trained, seen, unseen) in zip(
        summary(evaluation, surrogate)["variations"], [(4, 4, 2), (6, 6, 3)], strict=True
    ):
        assert record["settings_trained"] == trained
        shown = record["trivial_predictors"][0]["settings_shown"]
        assert shown["seen_parameters"] == [seen, seen]
        assert shown["unseen_parameters"] == [unseen, unseen]


def summary(evaluation: Evaluation, surrogate: Surrogate) -> dict:
    from surrogate.report.summary import summarize

    return json.loads(json.dumps(summarize("x", surrogate, evaluation, dataset_seconds=None), allow_nan=False))


@pytest.mark.slow
def test_the_report_tells_all_of_it(wrong, tmp_path: Path) -> None:
    surrogate, catalog, evaluation = wrong
    write_report(tmp_path / "report", "blobs", surrogate, catalog, evaluation)
    record = json.loads((tmp_path / "report/report.json").read_text())
    page = (tmp_path / "report/report.md").read_text()
    for varied_record, varied_evaluation in zip(record["variations"], evaluation.variations, strict=True):
        check_record(varied_record, varied_evaluation)
    assert all(len(set(widths)) == 1 for widths in tables(page))
    for picture in ("comparison.png", "isovalue.png", "transfer_function.png"):
        assert f"({picture})" in page
        assert 5_000 < (tmp_path / "report" / picture).stat().st_size < 400_000
    behind = record["variations"][0]["behind"]["unseen_parameters"]
    assert f"{abs(behind):.2f} dB {'behind' if behind >= 0 else 'ahead of'} seen ones at unseen parameters" in page
    assert "nearest trained setting (unseen parameters: from 2 of 4)" in page
    assert all(f"| {name} | test |" in page for name in UNSEEN)
    assert "| iso=16 | train |" in page
    assert "tf-train-3" not in page
    assert sorted(p.name for p in tmp_path.iterdir()) == ["report"]


def check_record(record: dict, evaluation: VariedEvaluation) -> None:
    psnr = record["psnr"]
    for column in PARAMETERS:
        expected = psnr["seen_settings"][column] - psnr["unseen_settings"][column]
        assert record["behind"][column] == pytest.approx(expected)
    for metric in (*METRICS, "covered"):
        assert record[metric]["unseen_settings"]["unseen_parameters"] is not None
        assert record["validation"][metric] is not None
    nearest = record["trivial_predictors"][0]
    for column in PARAMETERS:
        lead = psnr["unseen_settings"][column] - nearest["psnr"][column]
        assert nearest["lead"][column] == pytest.approx(lead)
    assert [s["name"] for s in record["settings"]] == [s.appearance for s in evaluation.variation.settings]
    unseen = [s for s in record["settings"] if s["split"] == "test"]
    for setting in unseen:
        scored = [
            s
            for s in evaluation.cells["unseen_settings"]["unseen_parameters"]
            if s.target.appearance == setting["name"]
        ]
        assert setting["psnr"]["unseen_parameters"] == pytest.approx(np.mean([s.score.psnr for s in scored]))
        assert setting["worst"]["unseen_parameters"] == min(s.score.psnr for s in scored)
    assert set(record["milliseconds"]) == {"visualization_change", "view_change"}
    assert all(0 < ms < 1000 for ms in record["milliseconds"].values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("members", "empty"),
    [
        ({"train-0": (0.0, ("dvr", "iso=1", "iso=4", "tf-train-0"))}, "everything unseen"),
        (
            {"train-0": (0.0, ("dvr",)), "train-1": (0.5, ("dvr",)), "test-0": (1.0, ("dvr", *UNSEEN))},
            "everything seen",
        ),
        ({"train-0": (0.0, ("dvr",)), "train-1": (0.5, ("dvr",))}, "all"),
    ],
)
def test_cells_without_images_are_null(tmp_path: Path, members: dict, empty: str) -> None:
    surrogate = varied_surrogate()
    catalog = varied_catalog(tmp_path / "a.cdb", surrogate, members)
    record = write_report(tmp_path / "report", "x", surrogate, catalog, evaluate(surrogate, catalog))
    isovalues = record["variations"][0]
    assert isovalues["behind"] == {"seen_parameters": None, "unseen_parameters": None}
    assert (isovalues["psnr"]["seen_settings"]["seen_parameters"] is None) == (empty != "everything unseen")
    assert (isovalues["psnr"]["unseen_settings"]["unseen_parameters"] is None) == (empty != "everything seen")
    nearest = isovalues["trivial_predictors"][0]  # no member here shows both trained and unseen isovalues
    assert nearest["psnr"] == {"seen_parameters": None, "unseen_parameters": None, "validation": None}
    assert isovalues["validation"]["psnr"] is None
    page = (tmp_path / "report/report.md").read_text()
    assert "The data set shows no unseen isovalues beside seen ones." in page
    assert ("(isovalue.png)" in page) == (empty != "all")


def test_without_variations_nothing_is_said_about_them(perfect, tmp_path: Path) -> None:
    surrogate, catalog, _ = perfect
    plain = replace(surrogate, visualizations=())
    evaluation = evaluate(plain, catalog)
    record = write_report(tmp_path / "report", "x", plain, catalog, evaluation)
    assert record["variations"] == []
    assert "covered" not in record["definitions"]
    page = (tmp_path / "report/report.md").read_text()
    assert "isovalue" not in page
    assert "transfer function" not in page


@pytest.mark.usefixtures("undrawn")
def test_a_report_is_not_current_where_other_metrics_can_be_had(
    perfect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    surrogate, catalog, evaluation = perfect
    lacking = replace(evaluation, unavailable={"lpips": "no such file", "flip": "no such package"})
    write_report(tmp_path / "report", "x", surrogate, catalog, lacking)
    monkeypatch.setattr(PerceptualMetrics, "load", lambda: PerceptualMetrics({}, {"lpips": "", "flip": ""}))
    assert is_current(tmp_path / "report", surrogate)
    monkeypatch.setattr(PerceptualMetrics, "load", lambda: PerceptualMetrics({}, {"lpips": ""}))
    assert not is_current(tmp_path / "report", surrogate)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_perceptual_metrics_and_why_they_are_missing_stand_in_the_record(
    perfect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    surrogate, catalog, _ = perfect
    found = PerceptualMetrics({"ms_ssim": lambda *_: float("nan"), "flip": lambda *_: 0.125}, {"lpips": "no weights"})
    monkeypatch.setattr(PerceptualMetrics, "load", lambda: found)
    record = write_report(tmp_path / "report", "x", surrogate, catalog, evaluate(surrogate, catalog))
    assert record["unavailable"] == {"lpips": "no weights"}
    assert record["flip"]["unseen_views"] == {"seen_parameters": None, "unseen_parameters": 0.125}
    assert record["variations"][1]["flip"]["unseen_settings"]["seen_parameters"] == 0.125
    assert record["lpips"]["unseen_views"]["unseen_parameters"] is None
    page = (tmp_path / "report/report.md").read_text()
    assert "no weights" not in page
    assert page.count("LPIPS") == 1


@pytest.mark.usefixtures("undrawn")
def test_the_command_line_says_a_line_for_each_variation(perfect, tmp_path: Path) -> None:
    surrogate, catalog, _ = perfect
    surrogate.save(catalog.path.parent / "surrogate")
    scene = tmp_path / "blobs.toml"
    scene.write_text('name = "blobs"\n[source]\nkind = "nerf"\npath = "none"\n')
    result = CliRunner().invoke(main, ["evaluate", str(scene), "--runs", str(catalog.path.parent.parent)])
    assert result.exit_code == 0, result.output
    for names in ("isovalues", "transfer functions"):
        lines = [line for line in result.output.splitlines() if f"unseen {names}, unseen parameters" in line]
        assert len(lines) == 1
        assert "60.00 dB" in lines[0]
        assert "0.00 dB behind seen ones" in lines[0]
