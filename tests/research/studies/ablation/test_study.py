"""Studies on an ensemble of blobs, with budgets of a fraction of a second."""

import json
import time
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from research.studies.ablation import experiments
from research.studies.ablation import study as module
from research.studies.ablation.experiments import BaseExperiment, base_settings
from research.studies.ablation.records import AblationResult
from research.studies.ablation.study import AblationStudy, ablate
from research.studies.ablation.timing import clock
from surrogate.training.run import train
from tests.research.support.ablations import BUDGET, MEMBERS, SCENE, SMALL, VIEW_SPLITS, names

pytestmark = pytest.mark.usefixtures("given_step_times")


@pytest.mark.slow
def test_every_variant_is_fitted_once_per_seed_and_kept(conduct, tmp_path: Path) -> None:
    fitted = conduct(seeds=2, only=["joint"])
    assert names(fitted) == [("default", 0), ("joint", 0), ("default", 1), ("joint", 1)]
    for result in fitted:
        assert result.error == ""
        assert result.steps > 0
        assert result.images == 1  # the validation view of the validation member
        assert result.gaussians == 40
        assert 5.0 < result.psnr < 60.0
        assert result.provenance.machine
        assert result.provenance.commit
        assert result.provenance.processor_seconds > result.seconds
        assert result.scene == SCENE.to_json()
    assert {r.settings["seed"] for r in fitted} == {0, 1}
    assert (tmp_path / "ablation.png").read_bytes().startswith(b"\x89PNG")
    assert "| **default** |" in (tmp_path / "ablation.md").read_text()
    assert not list(tmp_path.glob("fits/*/surrogate"))


def test_scores_are_those_of_the_model_on_validation_images(conduct, catalog: Catalog, tmp_path: Path) -> None:
    (fitted,) = conduct(only=["default"])
    settings = base_settings(SCENE, catalog).changed(
        canonical_steps=fitted.canonical_steps,
        deformation_steps=fitted.deformation_steps,
    )
    surrogate = train(settings, catalog, tmp_path / "again")
    member, view = catalog.member("member-2"), 3
    truth = catalog.image(member, "drawn", view).astype(np.float64)
    picture = surrogate.at(p=0.5).render(member.cameras[view]).astype(np.float64)
    truth = truth / 255.0 if truth.max() > 1.0 else truth
    difference = (truth[..., :3] + 1 - truth[..., 3:]) - (picture[..., :3] + 1 - picture[..., 3:]).clip(0, 1)
    assert fitted.psnr == pytest.approx(-10.0 * np.log10(np.mean(difference**2)), abs=1e-3)


def test_a_finished_study_has_nothing_to_do_and_a_wider_one_only_what_is_missing(conduct, at_once) -> None:
    conduct(only=["joint"])
    assert conduct(only=["joint"]) == []
    assert names(conduct(seeds=2, only=["joint", "no-relocation"])) == [
        ("no-relocation", 0),
        ("default", 1),
        ("no-relocation", 1),
        ("joint", 1),
    ]


def test_records_answer_on_another_machine_unless_other_code_made_them(
    catalog: Catalog, at_once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fitted_in(folder: str) -> list[tuple[str, int]]:
        told: list[AblationResult] = []
        options = {"records": tmp_path / "kept", "seconds": BUDGET, "seeds": 1, "only": ["joint"]}
        ablate("blobs", BaseExperiment(SCENE, catalog), tmp_path / folder, tell=told.append, **options)
        return names(told)

    assert fitted_in("here") == [("default", 0), ("joint", 0)]
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == ["default.seed0.json", "joint.seed0.json"]
    assert fitted_in("elsewhere") == []
    assert "| joint |" in (tmp_path / "elsewhere" / "ablation.md").read_text()
    monkeypatch.setattr(module, "code", lambda *_: "later")
    monkeypatch.setattr("surrogate.storage.records.code", lambda *_: "later")
    assert fitted_in("here") == [("default", 0), ("joint", 0)]
    assert fitted_in("elsewhere") == []


def test_results_of_other_settings_budgets_or_data_are_not_taken(conduct, make_catalog, at_once) -> None:
    conduct(only=["default"])
    assert names(conduct(SCENE.changed(gaussians=41), only=["default"])) == [("default", 0)]
    assert names(conduct(SCENE.changed(gaussians=41), only=["default"], seconds=0.3)) == [("default", 0)]
    other = make_catalog(SMALL, members=(("train", 0.1), *MEMBERS[1:]), view_splits=VIEW_SPLITS, name="other.cdb")
    assert names(conduct(SCENE.changed(gaussians=41), data=other, only=["default"], seconds=0.3)) == [("default", 0)]
    assert conduct(SCENE.changed(gaussians=41), data=other, only=["default"], seconds=0.3) == []


def test_what_took_another_time_is_repeated_only_when_that_is_asked_for(conduct, at_once, tmp_path: Path) -> None:
    conduct(only=["joint"])
    path = tmp_path / "joint.seed0.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps(record | {"values": record["values"] | {"seconds": BUDGET}}))
    assert conduct(only=["joint"]) == []
    assert names(conduct(only=["joint"], again=True)) == [("default", 0)]


def test_what_took_the_steps_of_a_repeated_fit_is_repeated_in_the_same_run(
    conduct, at_once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = {"default": 10, "samples-2": 1, "default-in-samples-2-steps": 1}
    monkeypatch.setattr(
        module.AblationStudy,
        "_fit",
        lambda _, variant, *__: {"deformation_steps": steps[variant.name], "psnr": 20.0, "seconds": BUDGET},
    )
    conduct(only=["default-in-samples-2-steps"])
    (tmp_path / "samples-2.seed0.json").unlink()
    steps |= {"samples-2": 2, "default-in-samples-2-steps": 2}
    assert names(conduct(only=["default-in-samples-2-steps"])) == [("samples-2", 0), ("default-in-samples-2-steps", 0)]


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"variant": "default"}', "null"])
def test_a_damaged_result_is_made_again(conduct, at_once, tmp_path: Path, content: str) -> None:
    (tmp_path / "default.seed0.json").write_text(content)
    assert names(conduct(only=["default"])) == [("default", 0)]
    assert json.loads((tmp_path / "default.seed0.json").read_text())["values"]["psnr"] == 20.0


def test_what_is_not_asked_for_now_stays_in_the_table(conduct, at_once, tmp_path: Path) -> None:
    conduct(only=["joint"])
    conduct(only=["no-relocation"])
    page = (tmp_path / "ablation.md").read_text()
    assert all(f"| {name} |" in page for name in ("joint", "no-relocation"))


def test_a_failing_variant_says_why_stops_no_other_and_is_tried_again(conduct, tmp_path: Path) -> None:
    fitted = conduct(only=["start-in-situ", "start-random", "no-relocation"])
    errors = {result.variant: result.error for result in fitted}
    assert errors["default"] == errors["no-relocation"] == ""
    assert "no training member of this catalog has sampled points" in errors["start-in-situ"]
    assert errors["start-random"] == "the scene's settings say the same, so this is the default"
    page = (tmp_path / "ablation.md").read_text()
    assert "| start-in-situ | 0 | training.initialization is" in page
    assert names(conduct(only=["start-in-situ", "no-relocation"])) == [("start-in-situ", 0)]


def test_any_exception_is_a_row(conduct, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise MemoryError("no\n room")

    monkeypatch.setattr(experiments, "train", fail)
    assert conduct(only=["default"])[0].error == "MemoryError: no room"


def test_a_model_that_shows_no_numbers_is_a_failure(conduct, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "mean", lambda *_: float("nan"))
    assert "training diverged" in conduct(only=["default"])[0].error


@pytest.mark.slow
def test_equally_many_steps_are_taken_or_refused(conduct, tmp_path: Path) -> None:
    fitted = {
        r.variant: r for r in conduct(only=["default-in-samples-2-steps", "samples-2-in-default-steps"], longest=1e-3)
    }
    assert fitted["default-in-samples-2-steps"].error.endswith("--longest allows more")
    again = {r.variant: r for r in conduct(only=["default-in-samples-2-steps"], longest=60.0)}
    assert again["default-in-samples-2-steps"].steps == fitted["samples-2"].steps
    path = tmp_path / "samples-2.seed0.json"
    record = json.loads(path.read_text())
    path.write_text(
        json.dumps(record | {"values": record["values"] | {"deformation_steps": fitted["samples-2"].steps + 7}})
    )
    assert names(conduct(only=["default-in-samples-2-steps"], longest=60.0)) == [("default-in-samples-2-steps", 0)]


def test_the_time_of_a_fit_is_its_own() -> None:
    now = clock(SCENE)
    before, began = now(), time.perf_counter()
    time.sleep(0.3)
    assert now() - before < 0.2  # others had the processor
    while now() - before < 0.2:
        assert time.perf_counter() - began < 30.0


def test_nothing_is_chosen_on_the_way(catalog: Catalog) -> None:
    base = base_settings(SCENE, catalog)
    assert (base.initialization, base.color_degree, base.fit_to_need) == ("random", 0, False)
    assert (base.validation_images, base.visualization_steps) == (0, 0)
    assert base_settings(SCENE.changed(color_degree=1), catalog).color_degree == 1


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"seconds": 0.0}, "seconds must be positive, got 0.0"),
        ({"seeds": 0}, "seeds must be positive"),
        ({"longest": 0.0}, "longest must be positive, got 0.0"),
        ({"only": ["nonsense"]}, "unknown variants"),
    ],
)
def test_impossible_studies_are_refused(catalog: Catalog, tmp_path: Path, options: dict, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        AblationStudy(BaseExperiment(SCENE, catalog), tmp_path, **options)


def test_a_catalog_without_validation_images_is_refused(make_catalog, tmp_path: Path) -> None:
    bare = make_catalog(members=(("train", 0.0), ("test", 1.0)), view_splits=("train", "test"))
    with pytest.raises(ValueError, match="has no validation images"):
        BaseExperiment(SCENE, bare)
