"""Other fields shown by the same Gaussians: learnt beside a base that stays what it is, asked for by name, judged, reported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.variations import field_variation, transfer_function_family
from surrogate import Surrogate, TrainingSettings, train
from surrogate.cli import main
from surrogate.evaluation.cases import PARAMETERS
from surrogate.evaluation.evaluate import evaluate
from surrogate.evaluation.metrics import psnr
from surrogate.gaussians import NAMES
from surrogate.report.report import write_report
from surrogate.report.variations import variation_line
from surrogate.storage.checkpoints import fingerprint
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.visualizations import new_visualization, visualization_stage
from tests.support.comparing import same
from tests.support.field_blobs import BLOBS, FieldBlobs, summary
from tests.support.interruptions import interrupt, outcome
from tests.support.other_fields import BASE, FIELDS, MEMBERS, OTHER, SPEED, SURFACE, fields_catalog, points
from tests.support.tables import squared_error, tables
from tests.support.visualizations import base

QUICK = TrainingSettings(
    gaussians=40,
    canonical_steps=6,
    deformation_steps=8,
    visualization_steps=10,
    latent_size=3,
    hidden_width=4,
    validation_interval=5,
    relocation_interval=5,
    checkpoint_seconds=1e6,
)


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return fields_catalog(tmp_path_factory.mktemp("fields") / "a.cdb")


@pytest.fixture(scope="module")
def run(catalog: Catalog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run: `surrogate` and, beside it, a link to its catalog."""
    folder = tmp_path_factory.mktemp("run")
    train(QUICK, catalog, folder / "surrogate")
    (folder / "catalog.cdb").symlink_to(catalog.path)
    return folder


def test_what_the_sidecar_knows_is_of_the_field_that_is_learnt(catalog: Catalog) -> None:
    for appearance, kept, count in (("", summary(BLOBS), 0), ("speed-dvr", summary(FieldBlobs(count=5)), 3 * 7)):
        source = Source(TrainingSettings(appearance=appearance), catalog)
        counts, _ = source.histogram
        np.testing.assert_array_equal(counts, 3 * kept.histogram)
        assert (0 if source.points is None else len(source.points.places)) == count
    found = Source(TrainingSettings(appearance="speed-dvr"), catalog).points
    assert found is not None
    np.testing.assert_allclose(found.colors, np.tile(OTHER.colors(points(7)["point_values"]), (3, 1)), atol=1e-6)


def test_a_field_is_learnt_from_all_training_members(catalog: Catalog) -> None:
    source = Source(QUICK, catalog)
    assert source.variations == (FIELDS,)
    data = source.data(FIELDS)
    assert len(data.examples) == 3 * 2 * 5
    assert {tuple(e.parameters[1:].tolist()) for e in data.examples} == {(1.0, 0.0), (0.0, 1.0)}
    judges = source.decision_images(FIELDS)
    assert [e.parameters[0].item() for e in judges] == pytest.approx([-0.2] * 2), "the validation member's"
    assert len(judges) == 2
    assert Source(QUICK.changed(appearance="speed-dvr"), catalog).variations == ()


def test_f_vis_moves_everything_and_leaves_the_base_as_it_is_bit_for_bit(catalog: Catalog) -> None:
    settings = QUICK
    source, fitted = Source(settings, catalog), base()
    before = [t.detach().numpy().tobytes() for t in fitted.tensors().values()]
    visual = new_visualization(*fitted, FIELDS, source)
    assert [name for name in NAMES if visual.deformation.moves(name)] == list(NAMES)
    assert visual.simulation is not None
    stage = visualization_stage(*fitted, visual, settings)
    assert stage.name == "field"
    stage_run = StageRun(stage, settings, source.data(FIELDS))
    for _ in range(4):
        stage_run.advance()
    assert [t.detach().numpy().tobytes() for t in fitted.tensors().values()] == before
    place = torch.tensor([0.3, *FIELDS.normalize(None)], dtype=torch.float32)
    assert same(visual.gaussians_at(*fitted, place), fitted.at(place[:1]))


def test_a_surrogate_shows_each_appearance_by_its_name(run: Path) -> None:
    surrogate = Surrogate.load(run / "surrogate")
    camera = BLOBS.cameras()[0]
    shown = {name: surrogate.at(p=0.3, appearance=name) for name in ("dvr", "speed-dvr", "surface")}
    assert same(shown["dvr"].gaussians, surrogate.at(p=0.3).gaussians)
    pictures = [deformed.render(camera) for deformed in shown.values()]
    assert not np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[1], pictures[2])
    assert surrogate.visualization_names == ("appearance",)
    assert shown["surface"].parameters == {"p": 0.3, "appearance": "surface"}
    assert "at p=0.3, appearance='surface'" in repr(shown["surface"])
    assert "also as speed-dvr, surface" in repr(surrogate)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (
            {"p": 0.3, "appearance": "speed"},
            r"appearance must be one of dvr, speed-dvr, surface, got 'speed'",
        ),
        ({"p": 0.3, "appearance": 1.0}, r"dvr, speed-dvr, surface, got 1.0"),
        ({"p": 0.3, "appearance": np.array(["dvr", "surface"])}, r"dvr, speed-dvr, surface, got array"),
        ({"p": 0.3, "appearance": None}, r"dvr, speed-dvr, surface, got None"),
        ({"appearance": "surface"}, r"missing p"),
        ({"p": 0.3, "speed-dvr": 1.0}, r"unknown speed-dvr"),
        ({"p": 0.3, "field": "speed"}, r"unknown field"),
    ],
)
def test_what_it_does_not_show_is_refused(run: Path, asked: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Surrogate.load(run / "surrogate").at(**asked)


def test_one_without_fields_does_not_know_the_word(catalog: Catalog, run: Path) -> None:
    plain = replace(Surrogate.load(run / "surrogate"), visualizations=())
    with pytest.raises(ValueError, match=r"unknown appearance"):
        plain.at(p=0.3, appearance="speed-dvr")


def test_the_command_draws_a_field(run: Path, tmp_path: Path) -> None:
    drawn = CliRunner().invoke(
        main, ["export", str(run), "-p", "p=0.3", "-p", "appearance=surface", "-o", str(tmp_path / "a.png")]
    )
    assert drawn.exit_code == 0, drawn.output
    assert (tmp_path / "a.png").is_file()
    to = ["-o", str(tmp_path / "b.png")]
    wrong = CliRunner().invoke(main, ["export", str(run), "-p", "p=0.3", "-p", "appearance=speed", *to])
    assert "dvr, speed-dvr, surface, got 'speed'" in wrong.output
    assert "NAME=VALUE, got 'p=speed'" in CliRunner().invoke(main, ["export", str(run), "-p", "p=speed", *to]).output
    assert not (tmp_path / "b.png").exists()


def test_an_interrupted_run_ends_where_an_undisturbed_one_does(catalog: Catalog, run: Path, tmp_path: Path) -> None:
    for when in (
        lambda p: p.stage == "varied colour degree",
        lambda p: p.stage == "field" and p.step >= 17,
        lambda p: p.stage == "field" and p.step == 24,
    ):
        interrupt(when, QUICK, catalog, tmp_path / "resumed")
    train(QUICK, catalog, tmp_path / "resumed")
    assert outcome(tmp_path / "resumed") == outcome(run / "surrogate")
    names = [c["name"] for c in Surrogate.load(tmp_path / "resumed").training["choices"]]
    assert names[-3:] == ["varied colour degree", "precision", "precision, field"]


def test_the_fields_belong_to_what_a_run_is_recognized_by(catalog: Catalog, tmp_path: Path) -> None:
    same_again = fields_catalog(tmp_path / "a.cdb", MEMBERS[:1])
    other = fields_catalog(tmp_path / "b.cdb", MEMBERS[:1], looks=(BASE, SPEED, replace(SURFACE, field="q")))
    assert fingerprint(QUICK, same_again) != fingerprint(QUICK, other)


@pytest.mark.slow
def test_fields_are_recovered_at_unseen_parameters_and_views(tmp_path: Path) -> None:
    """Blobs under another transfer function: as well as one may, and far better than the base's picture."""
    catalog = fields_catalog(
        tmp_path / "a.cdb", looks=(BASE, SPEED), variations=(field_variation("dvr", appearances=["speed-dvr"]),)
    )
    settings = TrainingSettings(
        gaussians=60,
        canonical_steps=150,
        deformation_steps=250,
        visualization_steps=500,
        validation_interval=0,
        fit_to_need=False,
        color_degree=0,
        visualization_color_degree=0,
    )
    surrogate, camera = train(settings, catalog, tmp_path / "surrogate"), BLOBS.cameras()[6]
    truth = BLOBS.drawn(0.7, SPEED, camera)
    found = psnr(truth, surrogate.at(p=0.7, appearance="speed-dvr").render(camera))
    assert found > psnr(truth, surrogate.at(p=0.7).render(camera)) + 6.0
    assert found > 24.0


@pytest.mark.slow
def test_the_report_shows_fields_as_seen_settings(catalog: Catalog, run: Path, tmp_path: Path) -> None:
    surrogate = Surrogate.load(run / "surrogate")
    evaluation = evaluate(surrogate, catalog)
    (varied,) = evaluation.variations
    cells = varied.cells["seen_settings"]
    assert [len(cells[column]) for column in PARAMETERS] == [3 * 2, 2]
    assert not any(varied.cells["unseen_settings"].values())
    assert varied.baselines == []
    assert len(varied.validation) == 2 * 6
    for scored in varied.scored:
        case = scored.target
        truth = catalog.image(case.member, case.appearance, case.view)
        picture = surrogate.at(p=case.member.parameters["p"], appearance=case.appearance).render(case.camera)
        assert scored.score.psnr == pytest.approx(-10 * np.log10(squared_error(truth, picture)), abs=1e-3)
    record = write_report(tmp_path / "report", "fields", surrogate, catalog, evaluation)
    (fields,) = record["variations"]
    assert fields["psnr"]["unseen_settings"] == {"seen_parameters": None, "unseen_parameters": None}
    assert fields["behind"] == {"seen_parameters": None, "unseen_parameters": None}
    assert [s["name"] for s in fields["settings"]] == ["speed-dvr", "surface"]
    assert all(s["psnr"]["unseen_parameters"] is not None for s in fields["settings"])
    page = (tmp_path / "report" / "report.md").read_text()
    assert "## Other fields" in page
    assert "Shown instead of the appearance `dvr`: `speed-dvr`, `surface`." in page
    assert "| surface | train |" in page
    assert "nseen other fields" not in page
    assert all(len(set(widths)) == 1 for widths in tables(page))
    assert (tmp_path / "report" / "field.png").stat().st_size > 5_000
    assert f"{fields['psnr']['seen_settings']['unseen_parameters']:.2f} dB" in variation_line(fields)


@pytest.mark.slow
@pytest.mark.parametrize(
    "members", [MEMBERS[:3], MEMBERS[:4], (MEMBERS[0], MEMBERS[4])], ids=["train", "no test", "no validation"]
)
def test_a_report_of_fewer_members_is_written_too(tmp_path: Path, run: Path, members: tuple) -> None:
    catalog, surrogate = fields_catalog(tmp_path / "a.cdb", members), Surrogate.load(run / "surrogate")
    record = write_report(tmp_path / "report", "fields", surrogate, catalog, evaluate(surrogate, catalog))
    (fields,) = record["variations"]
    untested = not any(split == "test" for split, _ in members)
    assert (fields["psnr"]["seen_settings"]["unseen_parameters"] is None) == untested
    assert ("none at unseen parameters" in variation_line(fields)) == untested
    assert (fields["validation"]["images"] == 0) == (len(members) != 4)


@pytest.mark.slow
def test_fields_and_transfer_functions_are_learnt_side_by_side(tmp_path: Path) -> None:
    family = transfer_function_family(BASE, first_step=(0.2, 0.1), second_step=(0.2, 0.1), validation=1, test=1)
    catalog = fields_catalog(
        tmp_path / "a.cdb",
        MEMBERS[2:5],
        looks=(BASE, SPEED, SURFACE, *family.appearances),
        shown=["dvr", "speed-dvr", "surface", "dvr-train-01", "dvr-validation-01", "dvr-test-01"],
        variations=(family.variation, FIELDS),
    )
    surrogate = train(QUICK, catalog, tmp_path / "surrogate")
    assert surrogate.visualization_names == (*family.variation.space.names, "appearance")
    for asked in ({"appearance": "surface"}, {"c1_value": 0.1}, {}):
        assert np.isfinite(surrogate.at(p=0.3, **asked).render(BLOBS.cameras()[0])).all()
    assert np.isfinite(surrogate.under(OTHER, p=0.3).render(BLOBS.cameras()[0])).all()
    with pytest.raises(ValueError, match="belong to different variations"):
        surrogate.at(p=0.3, c1_value=0.1, appearance="surface")
    record = write_report(tmp_path / "report", "both", surrogate, catalog, evaluate(surrogate, catalog))
    assert [v["kind"] for v in record["variations"]] == ["transfer_function", "field"]
