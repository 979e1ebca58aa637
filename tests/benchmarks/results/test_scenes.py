"""What is read is of the scene as it now is, and what is missing is named with the command that makes it."""

import json
from pathlib import Path

import pytest

from benchmarks.results.scenes import Gap, read_scene, read_scenes
from tests.support.results import make_catalog, make_results, make_scene, make_study


def gaps(root: Path, name: str) -> dict[str, str]:
    return {gap.what: gap.command for gap in read_scene(root / "scenes" / f"{name}.toml", root / "runs").gaps}


def test_a_scene_without_a_data_set_lacks_everything(tmp_path: Path) -> None:
    path = make_scene(tmp_path, "absent")
    found = read_scene(path, tmp_path / "runs")
    assert found.report is None
    assert found.gaps == [Gap("absent", "everything", "make results SCENES=absent")]
    assert not (tmp_path / "runs").exists()


def test_an_unfinished_data_set_counts_as_none(tmp_path: Path) -> None:
    make_scene(tmp_path, "begun")
    (tmp_path / "runs/begun/catalog.cdb").mkdir(parents=True)
    assert list(gaps(tmp_path, "begun")) == ["everything"]


def test_what_is_missing_of_a_data_set_is_named(tmp_path: Path) -> None:
    make_scene(tmp_path, "bare")
    make_catalog(tmp_path, "bare")
    assert gaps(tmp_path, "bare") == {
        "the report": "make results SCENES=bare",
        "the ceiling of drawn": "surrogate ceiling scenes/bare.toml",
        "other seeds": "surrogate repeat scenes/bare.toml",
        "the ablation of the base appearance": "surrogate ablate scenes/bare.toml",
    }


def test_nothing_is_missing_of_a_whole_scene(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "whole", 30.0, seeds=(30.0, 31.0))
    make_study(tmp_path, "whole", catalog, {"default": (30.0,)})
    found = read_scene(tmp_path / "scenes/whole.toml", tmp_path / "runs")
    assert found.gaps == []
    assert found.report is not None
    assert found.report["gaussians"] == 1234
    assert found.base == "pictures made elsewhere"
    assert [entry["psnr"] for entry in found.ceilings] == [32.0]
    assert found.repeats is not None
    assert found.repeats["psnr"]["seen_views"]["seen_parameters"]["mean"] == 30.5
    assert [study.budget for study in found.studies] == [60.0]


def test_results_of_other_settings_count_as_missing(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "changed", 30.0, seeds=(30.0, 31.0))
    make_study(tmp_path, "changed", catalog, {"default": (30.0,)})
    make_scene(tmp_path, "changed", gaussians=21)
    assert list(gaps(tmp_path, "changed")) == [
        "the report",
        "the ceiling of drawn",
        "other seeds",
        "the ablation of the base appearance",
    ]


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"fingerprint": 3}', '{"fingerprint": "2:old"}'])
def test_a_report_that_is_damaged_or_of_an_earlier_evaluation_counts_as_missing(tmp_path: Path, content: str) -> None:
    make_results(tmp_path, "damaged", 30.0)
    (tmp_path / "runs/damaged/report/report.json").write_text(content)
    assert "the report" in gaps(tmp_path, "damaged")


def test_the_budget_with_most_results_is_shown(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "studied", 30.0)
    make_study(tmp_path, "studied", catalog, {"default": (30.0, 31.0), "joint": (29.0,)}, budget=60.0)
    make_study(tmp_path, "studied", catalog, {"no-decay": (20.0,)}, budget=5.0)
    (tmp_path / "runs/studied/ablation/notes.json").write_text(json.dumps({"mark": 1}))
    (study,) = read_scene(tmp_path / "scenes/studied.toml", tmp_path / "runs").studies
    assert study.budget == 60.0
    assert [row.variant.name for row in study.rows] == ["default", "joint"]


def test_a_scene_that_is_wrong_is_named(tmp_path: Path) -> None:
    make_scene(tmp_path, "wrong").write_text('name = "wrong"\nnonsense = 1\n')
    with pytest.raises(ValueError, match=r"wrong\.toml"):
        read_scenes(tmp_path / "scenes", tmp_path / "runs")


def test_reading_writes_nothing(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "read", 30.0, seeds=(30.0, 31.0))
    make_study(tmp_path, "read", catalog, {"default": (30.0,)})
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    read_scenes(tmp_path / "scenes", tmp_path / "runs")
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")} == before
