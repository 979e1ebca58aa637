"""Results belong to the scene's present settings, and missing ones are named with the command that makes them."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from research.benchmarks.results.ablations import study_section
from research.benchmarks.results.gaps import Gap, gaps_of
from research.benchmarks.results.scenes import SceneResults, read_scene, read_scenes
from research.benchmarks.results.sources import study_sources
from research.benchmarks.results.studies import BASE
from surrogate.storage.records import Provenance, Record
from tests.research.support.results import make_results, make_study
from tests.support.results import make_scene


def read(root: Path, name: str) -> SceneResults:
    return read_scene(root / "scenes" / f"{name}.toml", root / "records", root / "runs")


def gaps(root: Path, name: str) -> dict[str, str]:
    return {gap.what: gap.command for gap in gaps_of(read(root, name))}


def test_a_scene_without_records_lacks_everything(tmp_path: Path) -> None:
    make_scene(tmp_path, "absent")
    found = read(tmp_path, "absent")
    assert found.report is None
    assert gaps_of(found) == [Gap("absent", "everything", "make results SCENES=absent")]
    assert not (tmp_path / "runs").exists()


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "bare", 30.0)
    shutil.rmtree(tmp_path / "records/bare/ceiling")
    alone = "python -m research.studies ceiling scenes/bare.toml --records research/records"
    assert gaps(tmp_path, "bare") == {
        "the upper bound of pictures made elsewhere": alone,
        "other seeds": "python -m research.studies repeat scenes/bare.toml",
        "the ablation of the base appearance": "python -m research.studies ablate scenes/bare.toml",
    }
    shutil.rmtree(tmp_path / "records/bare/evaluation")
    make_study(tmp_path, "bare", catalog, {"default": (30.0,)})
    assert gaps(tmp_path, "bare") == {
        "the report": "make results SCENES=bare",
        "other seeds": "python -m research.studies repeat scenes/bare.toml",
    }


def test_nothing_is_missing_of_a_whole_scene_and_no_data_set_is_needed_to_know(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "whole", 30.0, seeds=(30.0, 31.0))
    make_study(tmp_path, "whole", catalog, {"default": (30.0,)})
    shutil.rmtree(tmp_path / "runs")
    found = read(tmp_path, "whole")
    assert gaps_of(found) == []
    assert found.report is not None
    assert found.report["gaussians"] == 1234
    assert found.base == "pictures made elsewhere"
    assert [entry["psnr"] for entry in found.upper_bounds] == [32.0]
    assert found.repeats is not None
    assert found.repeats["psnr"]["seen_views"]["seen_parameters"]["mean"] == 30.5
    assert [study.budget for study in found.studies] == [60.0]


def test_results_of_earlier_settings_stand_until_there_are_others_and_are_said_to_be_such(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "changed", 30.0, seeds=(30.0, 31.0))
    make_study(tmp_path, "changed", catalog, {"default": (30.0, 31.0)})
    assert not read(tmp_path, "changed").outdated
    make_scene(tmp_path, "changed", gaussians=21)
    found = read(tmp_path, "changed")
    assert found.outdated
    assert found.earlier
    assert ((found.report or {})["gaussians"], len(found.seeds), len(found.upper_bounds), len(found.studies)) == (
        1234,
        2,
        1,
        1,
    )
    assert gaps(tmp_path, "changed") == {"everything of its present settings": "make results SCENES=changed"}
    assert [result.psnr for result in found.studies[0].results] == [30.0, 31.0]

    def of_present(record: dict[str, Any], settings: str) -> None:
        record["key"][settings].update(gaussians=21)

    folder = tmp_path / "records/changed"
    changed(folder / "ablation/default.seed1.json", lambda record: of_present(record, "scene"))
    found = read(tmp_path, "changed")
    assert found.outdated
    assert [result.psnr for result in found.studies[0].results] == [31.0]
    changed(folder / "seeds/1.json", lambda record: of_present(record, "settings"))
    found = read(tmp_path, "changed")
    assert not found.outdated
    assert found.report is None
    assert [one.seed for one in found.seeds] == [1]


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"kind": "evaluation"}', '{"kind": "evaluation", "version": 2}'])
def test_a_report_that_is_damaged_or_of_an_earlier_evaluation_counts_as_missing(tmp_path: Path, content: str) -> None:
    make_results(tmp_path, "damaged", 30.0, seeds=(30.0, 31.0))
    (tmp_path / "records/damaged/evaluation/0.json").write_text(content)
    assert "the report" in gaps(tmp_path, "damaged")


def test_the_budget_with_most_results_is_shown(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "studied", 30.0)
    make_study(tmp_path, "studied", catalog, {"default": (30.0, 31.0), "joint": (29.0,)}, budget=60.0)
    make_study(tmp_path, "studied", catalog, {"no-decay": (20.0,)}, budget=5.0)
    (tmp_path / "records/studied/ablation/notes.json").write_text(json.dumps({"mark": 1}))
    (study,) = read(tmp_path, "studied").studies
    assert study.budget == 60.0
    assert [row.variant.name for row in study.rows] == ["default", "joint"]


def changed(path: Path, change: Any) -> None:
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))


@pytest.mark.parametrize("place", ["evaluation/0.json", "seeds/1.json", "ablation/default.seed0.json"])
def test_what_other_code_measured_is_shown_and_said_to_be_earlier(tmp_path: Path, place: str) -> None:
    catalog = make_results(tmp_path, "aged", 30.0, seeds=(30.0, 31.0))
    make_study(tmp_path, "aged", catalog, {"default": (30.0,)})
    assert not read(tmp_path, "aged").earlier
    changed(tmp_path / "records/aged" / place, lambda record: record["provenance"].update(code="before"))
    found = read(tmp_path, "aged")
    assert found.earlier
    assert gaps_of(found) == []


def test_what_an_earlier_page_said_of_a_study_stands_until_it_is_measured(tmp_path: Path) -> None:
    make_scene(tmp_path, "old")
    values = {"studies": {"ablation": {"lines": ["| default | 31.5 |"], "sources": "<sub>once</sub>"}}}
    Record("published", 1, {"scene": "old"}, values, Provenance("abc")).save(tmp_path / "records/old/published.json")
    old = read(tmp_path, "old")
    assert study_section(old.studies[0])[0] == "| default | 31.5 |"
    assert study_sources("old", old.studies[0]) == "<sub>once</sub>"
    assert old.earlier
    catalog = make_results(tmp_path, "old", 30.0)
    make_study(tmp_path, "old", catalog, {"default": (30.0,)})
    new = read(tmp_path, "old")
    assert [(study.kind, len(study.rows)) for study in new.studies] == [(BASE, 1)]
    assert not new.earlier


def test_a_scene_that_is_wrong_is_named(tmp_path: Path) -> None:
    make_scene(tmp_path, "wrong").write_text('name = "wrong"\nnonsense = 1\n')
    with pytest.raises(ValueError, match=r"wrong\.toml"):
        read_scenes(tmp_path / "scenes", tmp_path / "records", tmp_path / "runs")


def test_reading_writes_nothing(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "read", 30.0, seeds=(30.0, 31.0))
    make_study(tmp_path, "read", catalog, {"default": (30.0,)})
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    read_scenes(tmp_path / "scenes", tmp_path / "records", tmp_path / "runs")
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")} == before
