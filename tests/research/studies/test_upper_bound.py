import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from research.studies import upper_bound as module
from research.studies.progress import StudyProgress
from research.studies.upper_bound import UpperBoundSubject, line, measure_upper_bound, subjects
from research.studies.upper_bound_records import load_upper_bounds
from surrogate.initialization.pictures import central_member
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.training.source import Source
from tests.support.blobs import Blobs
from tests.support.other_fields import fields_catalog
from tests.support.varied_blobs import BLOBS, MEMBERS, varied_catalog, varied_surrogate

SCENE = TrainingSettings(gaussians=40, canonical_steps=10, deformation_steps=20, visualization_steps=30)
SMALL = Blobs(count=4, size=16)
VIEW_SPLITS = ("train",) * 6 + ("test",) * 2


@pytest.fixture(scope="module")
def surrogate() -> Surrogate:
    return varied_surrogate()


@pytest.fixture(scope="module")
def varied(tmp_path_factory: pytest.TempPathFactory, surrogate: Surrogate) -> Catalog:
    """Its images are what `surrogate` draws, base, isovalues and transfer functions."""
    return varied_catalog(tmp_path_factory.mktemp("varied") / "varied.cdb", surrogate)


def by_appearance(entries: list[dict]) -> dict[str, dict]:
    return {entry["appearance"]: entry for entry in entries}


def test_one_member_alone_is_learnt_well(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(SMALL, members=(("train", 0.0), ("train", 1.0), ("test", 0.7)), view_splits=VIEW_SPLITS)
    seen: list[StudyProgress] = []
    settings = SCENE.changed(gaussians=80, canonical_steps=200, deformation_steps=400)
    entries = measure_upper_bound(settings, catalog, tmp_path, progress=seen.append)
    (entry,) = entries
    assert (entry["member"], entry["appearance"], entry["steps"]) == ("member-2", "drawn", 600)
    assert (entry["train_views"], entry["test_views"]) == (6, 2)
    assert entry["psnr"] > 25.0
    assert entry["surrogate"] is None
    assert entry["seconds"] > 0
    assert (seen[-1].name, seen[-1].number, seen[-1].count, seen[-1].seconds_left) == ("drawn", 1, 1, 0.0)
    assert "600 / 600" in seen[-1].work
    assert load_upper_bounds(tmp_path) == entries


def test_the_base_and_the_middle_unseen_setting_of_every_variation_are_fitted(
    varied: Catalog, surrogate: Surrogate, tmp_path: Path
) -> None:
    found = by_appearance(measure_upper_bound(SCENE, varied, tmp_path, surrogate))
    assert {name: entry["steps"] for name, entry in found.items()} == {"dvr": 30, "iso=8": 60, "tf-test-1": 60}
    assert found["iso=8"]["parameters"] == {"p": 0.5, "isovalue": 8.0}
    for entry in found.values():
        assert entry["member"] == "test-0"
        assert entry["surrogate"]["psnr"] > 50.0  # the truth but for 8 bits
        assert entry["surrogate"]["gaussians"] == BLOBS.count
        assert entry["psnr"] < 40.0
        assert f"{entry['psnr']:.2f} dB" in line(entry)


def test_nothing_is_fitted_twice_but_a_new_surrogate_is_judged(
    varied: Catalog, surrogate: Surrogate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, settings = tmp_path, SCENE.changed(color_degree=0, visualization_color_degree=0)
    alone = by_appearance(measure_upper_bound(settings, varied, path))
    assert all(entry["surrogate"] is None for entry in alone.values())
    monkeypatch.setattr(module, "_fitted_alone", None)
    both = by_appearance(measure_upper_bound(settings, varied, path, surrogate))
    for name, entry in both.items():
        assert entry["surrogate"]["psnr"] > 50.0
        assert entry | {"surrogate": None} == alone[name]


@pytest.mark.parametrize("change", [{"gaussians": 41}, {"seed": 1}, {"samples": 2}, {"canonical_steps": 11}])
def test_other_settings_are_fitted_anew(make_catalog, tmp_path: Path, change: dict) -> None:
    catalog = make_catalog(SMALL, members=(("train", 0.0), ("test", 0.7)), view_splits=VIEW_SPLITS)
    (before,) = measure_upper_bound(SCENE, catalog, tmp_path)
    (after,) = measure_upper_bound(SCENE.changed(**change), catalog, tmp_path)
    assert before["mark"] != after["mark"]
    assert before["psnr"] != after["psnr"]


def test_an_interruption_keeps_what_is_finished(
    varied: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, fit, fitted = tmp_path, module._fitted_alone, []

    def interrupted(settings: TrainingSettings, source: Source, subject: UpperBoundSubject, watch: object) -> dict:
        if len(fitted) == 1:
            fitted.append("interrupted")
            raise KeyboardInterrupt
        fitted.append(subject.appearance)
        return fit(settings, source, subject, watch)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "_fitted_alone", interrupted)
    with pytest.raises(KeyboardInterrupt):
        measure_upper_bound(SCENE, varied, path)
    assert [entry["appearance"] for entry in load_upper_bounds(path)] == ["dvr"]
    measure_upper_bound(SCENE, varied, path)
    assert fitted == ["dvr", "interrupted", "iso=8", "tf-test-1"]


def test_colours_are_of_the_surrogates_degree_or_of_the_highest_it_may_choose(
    varied: Catalog, surrogate: Surrogate
) -> None:
    base, iso, _ = subjects(Source(SCENE, varied))
    lit = replace(surrogate, visualizations=tuple(replace(v, color_degree=1) for v in surrogate.visualizations))
    assert module._color_degree(SCENE, base, lit) == 0
    assert module._color_degree(SCENE, iso, lit) == 1
    assert module._color_degree(SCENE, iso, surrogate) == 0
    assert module._color_degree(SCENE, base, None) == 1
    flat = SCENE.changed(color_degree=0)
    assert module._color_degree(flat, base, None) == 0
    assert module._color_degree(flat, iso, None) == 1


def test_a_setting_that_no_test_member_shows_is_left_out(tmp_path: Path, surrogate: Surrogate) -> None:
    members = {**MEMBERS, "test-0": (0.5, ("dvr", "iso=8"))}
    catalog = varied_catalog(tmp_path / "some.cdb", surrogate, members)
    assert [s.appearance for s in subjects(Source(SCENE, catalog))] == ["dvr", "iso=8"]


def test_the_middle_member_is_that_nearest_to_the_mean(make_catalog) -> None:
    catalog = make_catalog(SMALL, members=[("test", p) for p in (1.0, 0.1, 0.2, 0.9, 0.45)], view_splits=("test",))
    assert central_member(catalog.members, catalog.plan.space).parameters["p"] == 0.45
    ends = [m for m in catalog.members if m.parameters["p"] in (0.1, 0.9)]
    assert central_member(ends, catalog.plan.space).name == "member-1"


def test_without_unseen_members_to_fit_the_training_member_with_the_most_test_views_is_taken(make_catalog) -> None:
    catalog = make_catalog(SMALL, members=(("train", 0.0), ("train", 0.4), ("train", 1.0)), view_splits=VIEW_SPLITS)
    (found,) = subjects(Source(SCENE, catalog))
    assert (found.member.split, found.member.parameters["p"]) == ("train", 0.4)


@pytest.mark.parametrize(
    ("members", "view_splits"),
    [((("train", 0.0), ("test", 1.0)), ("train",) * 4)],
    ids=["no test view"],
)
def test_a_catalog_that_tests_nothing_is_refused(
    make_catalog, tmp_path: Path, members: tuple, view_splits: tuple
) -> None:
    catalog = make_catalog(SMALL, members=members, view_splits=view_splits)
    with pytest.raises(ValueError, match="none can be fitted alone"):
        measure_upper_bound(SCENE, catalog, tmp_path)


@pytest.mark.parametrize("content", ["", "[]", "{", '{"version": 0, "entries": []}', '{"version": 1}'])
def test_a_file_that_is_none_counts_as_nothing(tmp_path: Path, content: str) -> None:
    assert load_upper_bounds(tmp_path) == []
    (tmp_path / "ceiling").mkdir()
    (tmp_path / "ceiling" / "drawn.json").write_text(content)
    assert load_upper_bounds(tmp_path) == []


def test_a_upper_bound_without_its_figures_counts_as_nothing(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(SMALL, members=(("train", 0.0), ("test", 0.7)), view_splits=VIEW_SPLITS)
    measure_upper_bound(SCENE, catalog, tmp_path)
    path = tmp_path / "ceiling" / "drawn.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"values": {"psnr": 30.0}}))
    assert load_upper_bounds(tmp_path) == []


def test_each_has_a_record_with_what_made_it(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(SMALL, members=(("train", 0.0), ("test", 0.7)), view_splits=VIEW_SPLITS)
    (entry,) = measure_upper_bound(SCENE, catalog, tmp_path)
    record = json.loads((tmp_path / "ceiling" / "drawn.json").read_text())
    assert record["values"]["psnr"] == entry["psnr"]
    assert record["key"]["settings"] == SCENE.to_json()
    assert record["provenance"]["processor_seconds"] > 0
    assert np.isfinite(entry["ssim"])


def test_other_code_measures_anew(make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    catalog = make_catalog(SMALL, members=(("train", 0.0), ("test", 0.7)), view_splits=VIEW_SPLITS)
    measure_upper_bound(SCENE, catalog, tmp_path)
    monkeypatch.setattr(module, "code", lambda *_: "later")
    monkeypatch.setattr(module, "_fitted_alone", lambda *_: {"psnr": 1.0, "ssim": 0.5})
    assert measure_upper_bound(SCENE, catalog, tmp_path)[0]["psnr"] == 1.0


def test_without_a_surrogate_what_an_earlier_one_reached_stays(
    varied: Catalog, surrogate: Surrogate, tmp_path: Path
) -> None:
    beside = measure_upper_bound(SCENE, varied, tmp_path, surrogate)
    assert measure_upper_bound(SCENE, varied, tmp_path) == beside


def test_fields_have_no_unseen_setting_that_could_be_fitted_alone(tmp_path: Path) -> None:
    source = Source(SCENE, fields_catalog(tmp_path / "fields.cdb"))
    assert [subject.appearance for subject in subjects(source)] == ["dvr"]
