"""Evaluation and report of a small surrogate: every number that a report promises, and nothing mixed up."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.version import UNKNOWN
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.cli import main
from surrogate.evaluation.cases import PARAMETERS, VIEWS, cases_of
from surrogate.evaluation.evaluate import evaluate
from surrogate.evaluation.metrics import score
from surrogate.evaluation.scoring import METRICS, mean
from surrogate.model import Surrogate
from surrogate.report.page import page as page_of
from surrogate.report.report import is_current, write_report
from surrogate.settings import TrainingSettings
from surrogate.training.run import train
from tests.support.tables import tables

SETTINGS = TrainingSettings(gaussians=30, canonical_steps=20, deformation_steps=20, validation_interval=10)
MEMBERS = {0.0: "train", 0.5: "validation", 0.75: "test", 1.0: "train"}
VALIDATION_VIEWS = [i for i, split in enumerate(view_splits(42)) if split == "validation"]


def disk(position: float, angle: float, size: int = 20) -> np.ndarray:
    """A premultiplied picture of a soft disk whose place depends on parameter and view."""
    y, x = np.mgrid[:size, :size] / (size - 1) - 0.5
    alpha = np.exp(-(((x - 0.3 * (position - 0.5) * np.cos(angle)) ** 2 + y**2) / 0.02))
    color = np.stack([position + 0 * x, 0.4 + 0 * x, 1.0 - position + 0 * x], axis=-1)
    return np.round(255 * np.concatenate([color * alpha[..., None], alpha[..., None]], axis=-1)).astype(np.uint8)


def make_catalog(path: Path, *, background: tuple[float, float, float] | None = None) -> Catalog:
    cameras = tuple(orbit((0, 0, 0), 1.7, width=20, height=20, frequency=2))
    plan = CatalogPlan(
        space=ParameterSpace((Parameter("shift", 0.0, 1.0),)),
        appearances=(ImportedImages("disk"),),
        cameras=cameras,
        view_splits=tuple(view_splits(len(cameras))),
        bounds=((-1, -1, -1), (1, 1, 1)),
        background=background,
    )
    catalog = Catalog.create(path, plan)
    for position, split in MEMBERS.items():
        with catalog.begin_member(f"{split}-{position}", {"shift": position}, split=split) as writer:
            for view, camera in enumerate(cameras):
                picture = disk(position, float(np.arctan2(camera.position[1], camera.position[0])))
                if background is not None:
                    picture[..., :3] += 255 - picture[..., 3:]
                    picture[..., 3] = 255
                writer.write_image("disk", view, picture)
    return catalog


@pytest.fixture(scope="module", params=[None, (1.0, 1.0, 1.0)], ids=["alpha", "opaque"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Surrogate, Catalog, Path]:
    folder = tmp_path_factory.mktemp("run")
    catalog = make_catalog(folder / "catalog.cdb", background=request.param)
    return train(SETTINGS, catalog, folder / "surrogate"), catalog, folder


def test_cells_hold_the_images_of_their_splits(run: tuple[Surrogate, Catalog, Path]) -> None:
    surrogate, catalog, _ = run
    evaluation = evaluate(surrogate, catalog)
    for views, view_split in VIEWS.items():
        for parameters, member_split in PARAMETERS.items():
            scored = evaluation.cells[views][parameters]
            assert scored
            assert {s.target.member.split for s in scored} == set(member_split)
            assert {s.target.member.view_splits[s.target.view] for s in scored} == set(view_split)
    assert {s.target.member.split for s in evaluation.validation} == {"validation"}
    first = evaluation.cells["unseen_views"]["unseen_parameters"][0]
    truth = catalog.image(first.target.member, "disk", first.target.view)
    picture = surrogate.at(**first.target.member.parameters).render(
        first.target.camera, background=catalog.plan.background
    )
    assert first.score == score(truth, picture, catalog.plan.background)


def test_trivial_predictors_are_what_they_say(run: tuple[Surrogate, Catalog, Path]) -> None:
    surrogate, catalog, _ = run
    results = {r.name.split(" (")[0]: r for r in evaluate(surrogate, catalog).baselines}
    assert set(results) == {
        "mean image",
        "nearest member",
        "inverse distances to the 4 nearest members",
        "linear interpolation",
        "ridge regression",
        "radial basis functions",
    }
    target = cases_of(catalog.members, {"disk": {}}, ("test",), ("test",))[3]
    low, high = (catalog.image(m, "disk", target.view, dtype="float32") for m in catalog.members if m.split == "train")
    truth = catalog.image(target.member, "disk", target.view)
    wanted = {
        "mean image": (low + high) / 2,
        "nearest member": high,
        "linear interpolation": 0.25 * low + 0.75 * high,
        "inverse distances to the 4 nearest members": 0.25 * low + 0.75 * high,  # of two at 3 to 1
    }
    for name, picture in wanted.items():
        scored = next(
            s
            for s in results[name].scores["unseen_views"]
            if s.target.view == target.view and s.target.member == target.member
        )
        assert scored.score.psnr == pytest.approx(score(truth, picture, catalog.plan.background).psnr, abs=1e-3)
        assert results[name].degrees == 0.0


def test_at_the_centre_every_member_looks_alike(run: tuple[Surrogate, Catalog, Path]) -> None:
    surrogate, catalog, _ = run
    evaluation, background = evaluate(surrogate, catalog), catalog.plan.background
    assert evaluation.at_center.keys() == evaluation.cells.keys()
    middle = surrogate.at(shift=0.5)
    for row, columns in evaluation.at_center.items():
        for column, scored in columns.items():
            assert [s.target for s in scored] == [s.target for s in evaluation.cells[row][column]]
            one = scored[-1]
            truth = catalog.image(one.target.member, "disk", one.target.view)
            assert one.score == score(truth, middle.render(one.target.camera, background=background), background)


@pytest.mark.slow
def test_the_report_holds_all_that_it_promises(run: tuple[Surrogate, Catalog, Path]) -> None:
    surrogate, catalog, folder = run
    evaluation = evaluate(surrogate, catalog)
    report = folder / "report"
    assert not is_current(report, surrogate)
    write_report(report, "disks", surrogate, catalog, evaluation, dataset_seconds=1.5)
    record = json.loads((report / "report.json").read_text())
    assert record["scene"] == "disks"
    assert record["seconds"]["dataset"] == 1.5
    assert {"commit", "version", "model_megabytes", "gaussians", "machine", "seed"} <= set(record)
    assert set(record["milliseconds"]) == {"parameter_change", "view_change"}
    for metric in METRICS:
        for views in VIEWS:
            for parameters in PARAMETERS:
                assert record[metric][views][parameters] == mean(evaluation.cells[views][parameters], metric)
    for views, parameters in ((v, p) for v in VIEWS for p in PARAMETERS):
        assert record["at_center"]["psnr"][views][parameters] == mean(evaluation.at_center[views][parameters], "psnr")
    assert record["at_center"]["parameters"] == {"shift": 0.5}
    assert record["decided_on"] == {"choices": len(VALIDATION_VIEWS), "watched": min(16, len(VALIDATION_VIEWS))}
    page = (report / "report.md").read_text()
    assert "frozen at the centre of parameter space (shift = 0.5)" in page
    assert "all choices were made on these" not in page
    for name in ("mean image", "nearest member", "linear interpolation"):
        assert name in page
    assert page.startswith(f"# disks\n\n{record['verdict']}\n\n")
    assert record["choices"]
    assert "precision" not in page
    assert "| making the data set | 2 s |" in page
    assert f"<sub>Commit `{record['commit']}`, " in page
    assert f"<sub>Version {record['version']}, " in page_of({**record, "commit": UNKNOWN}, {})
    assert all(len(set(widths)) == 1 for widths in tables(page))
    for picture in report.glob("*.png"):
        assert f"({picture.name})" in page
        assert picture.stat().st_size > 5000
    assert is_current(report, surrogate)
    write_report(report, "disks", surrogate, catalog, evaluation)  # and again, over the first
    assert json.loads((report / "report.json").read_text())["seconds"]["dataset"] is None
    assert "making the data set" not in (report / "report.md").read_text()
    assert sorted(p.name for p in folder.iterdir()) == ["catalog.cdb", "report", "surrogate"]
    changed = replace(surrogate, training={**surrogate.training, "fingerprint": "other"})
    assert not is_current(report, changed)


@pytest.mark.slow
def test_cells_without_images_are_null(tmp_path: Path) -> None:
    catalog = make_catalog(tmp_path / "a.cdb")
    import shutil

    shutil.rmtree(catalog.path / "members" / "test-0.75")
    shutil.rmtree(catalog.path / "members" / "validation-0.5")
    surrogate = train(SETTINGS, catalog, tmp_path / "surrogate")
    record = write_report(tmp_path / "report", "x", surrogate, catalog, evaluate(surrogate, catalog))
    assert record["psnr"]["unseen_views"]["unseen_parameters"] is None
    assert record["psnr"]["unseen_views"]["seen_parameters"] is not None
    assert record["trivial_predictors"] == []


SCENE = """
name = "disks"
[source]
kind = "nerf"
path = "none"
[training]
gaussians = 20
canonical_steps = 10
deformation_steps = 10
"""


@pytest.mark.slow
def test_the_command_line_trains_evaluates_renders_and_does_nothing_twice(tmp_path: Path) -> None:
    make_catalog(tmp_path / "runs/disks/catalog.cdb")
    scene = tmp_path / "disks.toml"
    scene.write_text(SCENE)
    runs = ["--runs", str(tmp_path / "runs")]

    def call(*arguments: str) -> str:
        result = CliRunner().invoke(main, list(arguments))
        assert result.exit_code == 0, result.output
        return result.output

    assert "Gaussians" in call("train", str(scene), *runs)
    assert "nothing to do" in call("train", str(scene), *runs)
    assert "report.md" in call("evaluate", str(scene), *runs)
    assert "nothing to do" in call("evaluate", str(scene), *runs)
    out = tmp_path / "picture.png"
    call("export", str(tmp_path / "runs/disks"), "-p", "shift=0.3", "--view", "4", "-o", str(out))
    assert out.is_file()
    assert "bilinear" in call("show", str(tmp_path / "runs/disks"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SCENE, "insitu dataset"),
        (SCENE.replace("gaussians = 20", "gausians = 20"), "insitu dataset"),
    ],
)
def test_without_a_catalog_the_way_to_one_is_named(tmp_path: Path, text: str, message: str) -> None:
    scene = tmp_path / "disks.toml"
    scene.write_text(text)
    result = CliRunner().invoke(main, ["train", str(scene), "--runs", str(tmp_path / "runs")])
    assert result.exit_code == 1
    assert message in result.output


def test_wrong_settings_and_parameters_are_named(tmp_path: Path) -> None:
    make_catalog(tmp_path / "runs/disks/catalog.cdb")
    scene = tmp_path / "disks.toml"
    scene.write_text(SCENE.replace("gaussians = 20", "gausians = 20"))
    result = CliRunner().invoke(main, ["train", str(scene), "--runs", str(tmp_path / "runs")])
    assert "gausians" in result.output
    scene.write_text(SCENE)
    assert CliRunner().invoke(main, ["train", str(scene), "--runs", str(tmp_path / "runs")]).exit_code == 0
    wrong = CliRunner().invoke(
        main, ["export", str(tmp_path / "runs/disks"), "-p", "Re=1", "-o", str(tmp_path / "a.png")]
    )
    assert wrong.exit_code == 1
    assert "shift" in wrong.output
