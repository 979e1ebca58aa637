"""What is expected comes from the nearest measurements, levelled to unseen members, and never from anything that tests."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from catalogs.catalog import Catalog
from surrogate import Surrogate
from surrogate.evaluation.metrics import MOST_DECIBELS
from surrogate.explore.reliability import expectation as module
from surrogate.explore.reliability.expectation import (
    FILE,
    NEAREST,
    VIEWS,
    Expectation,
    Measured,
    fingerprint,
    gap_of,
    left_out,
    left_out_error,
    measure,
    places_of,
    tables_of,
)
from surrogate.explore.setting import Setting
from surrogate.rasterizer import Rasterizer
from tests.support.models import following, plain
from tests.support.varied_blobs import varied_catalog, varied_surrogate


def measured(split: str, p: float, *psnr: float, varied: dict[str, float | str] | None = None) -> Measured:
    return Measured(f"{split}-{p:g}", split, {"p": p}, "dvr", varied or {}, psnr, seen_views=False)


def expected(rows: Sequence[Measured], surrogate: Surrogate | None = None) -> Expectation:
    return Expectation.of(rows, surrogate or plain(), ())


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> tuple[Surrogate, Catalog]:
    """A surrogate that predicts its own catalog exactly, but for the bits of its pictures."""
    surrogate = replace(varied_surrogate(), rasterizer=Rasterizer(backend="cpu"))
    return surrogate, varied_catalog(tmp_path_factory.mktemp("expectation") / "varied.cdb", surrogate)


@pytest.fixture(scope="module")
def known(ensemble: tuple[Surrogate, Catalog]) -> Expectation:
    return measure(*ensemble, None)


# ---- the numbers


def test_the_median_of_the_nearest_is_expected() -> None:
    rows = [
        measured("validation", p, psnr) for p, psnr in ((0.0, 10), (0.1, 20), (0.2, 22), (0.3, 90), (0.9, 5), (1, 6))
    ]
    found = expected(rows).at(Setting({"p": 0.1}), plain())
    assert NEAREST == 4
    assert (found.psnr, found.neighbours) == (21.0, 4)


def test_several_views_count_as_their_mean() -> None:
    assert expected([measured("validation", 0.5, 30.0, 40.0)]).at(Setting({"p": 0.5}), plain()).psnr == 35.0


def test_training_members_are_levelled_to_validation_members() -> None:
    training = [measured("train", p, 40.0 + 10.0 * p) for p in np.linspace(0.0, 1.0, 41)]
    unseen = [measured("validation", p, 37.0 + 10.0 * p) for p in (0.3, 0.7)]
    (table,) = tables_of([*training, *unseen], plain()).values()
    assert gap_of(table) == pytest.approx(3.0, abs=0.2)
    for p in (0.1, 0.5, 0.9):
        found = expected([*training, *unseen]).at(Setting({"p": p}), plain()).psnr
        assert found == pytest.approx(37.0 + 10.0 * p, abs=0.3)


def test_without_validation_members_there_is_no_gap() -> None:
    (table,) = tables_of([measured("train", p, 40.0) for p in (0.0, 1.0)], plain()).values()
    assert gap_of(table) is None
    assert expected([measured("train", 0.0, 40.0)]).at(Setting({"p": 0.0}), plain()).psnr == 40.0


def test_an_isosurface_is_expected_from_isosurfaces() -> None:
    rows = [measured("validation", 0.5, 50.0), measured("validation", 0.5, 30.0, varied={"isovalue": 0.4})]
    expectation = expected(rows, following())
    assert expectation.at(Setting({"p": 0.5}, {"isovalue": 0.7}), following()).psnr == 30.0
    assert expectation.at(Setting({"p": 0.5}, {"c1_value": 0.1}), following()).psnr == 50.0


def test_the_gap_of_the_base_serves_families_that_have_none() -> None:
    surfaces = [replace(measured("train", p, 30.0, varied={"isovalue": 0.3}), appearance="iso=0.3") for p in (0.0, 1.0)]
    rows = [*(measured("train", p, 44.0) for p in (0.0, 0.5, 1.0)), measured("validation", 0.5, 40.0), *surfaces]
    assert expected(rows, following()).at(Setting({"p": 0.0}, {"isovalue": 0.3}), following()).psnr == pytest.approx(
        26.0
    )


def test_what_is_left_out_is_told_from_other_members_and_settings_only() -> None:
    rows = [measured("validation", p, psnr) for p, psnr in ((0.0, 30.0), (1.0, 40.0))]
    (table,) = tables_of(rows, plain()).values()
    np.testing.assert_array_equal(left_out(table, None), [40.0, 30.0])
    assert left_out_error(table, None) == 10.0
    same = [
        replace(measured("validation", p, 30.0, varied={"isovalue": 0.4}), appearance="iso=0.4") for p in (0.0, 1.0)
    ]
    (table,) = tables_of(same, following()).values()
    assert np.isnan(left_out(table, None)).all()
    assert left_out_error(table, None) is None


def test_the_error_is_that_of_unseen_members_where_it_is_larger() -> None:
    training = [measured("train", p, 40.0) for p in np.linspace(0.0, 1.0, 41)]
    unseen = [measured("validation", p, psnr) for p, psnr in ((0.2, 30.0), (0.5, 35.0), (0.8, 40.0))]
    (table,) = tables_of([*training, *unseen], plain()).values()
    assert left_out_error(table, None) == pytest.approx(np.mean([7.5, 0.0, 7.5]))


# ---- what is said


def test_the_sentence_says_how_far_the_nearest_training_member_is(
    ensemble: tuple[Surrogate, Catalog], known: Expectation
) -> None:
    surrogate, _ = ensemble  # trained at 0 and 1
    found = known.at(Setting({"p": 0.25}), surrogate)
    assert found.training_distance == pytest.approx(0.25)
    assert found.training_spacing == pytest.approx(1.0)
    assert not found.far
    assert not found.warning
    assert "nearest training member 0.25 of the range away" in found.sentence
    assert found.sentence.startswith("expected ")


def test_far_from_training_and_out_of_bounds_warn(ensemble: tuple[Surrogate, Catalog], known: Expectation) -> None:
    surrogate, _ = ensemble
    found = known.at(Setting({"p": 2.5}), surrogate)
    assert found.far
    assert found.warning
    assert found.outside == ("p",)
    assert "farther than usual" in found.sentence
    assert "p out of bounds" in found.sentence


def test_nothing_is_expected_of_colours_that_were_never_trained() -> None:
    found = expected([measured("validation", 0.5, 50.0)], following()).at(
        Setting({"p": 0.5}, {}, "viridis"), following()
    )
    assert found.psnr is None
    assert found.warning
    assert "colours" in found.sentence


def test_nothing_is_expected_without_a_catalog() -> None:
    found = measure(plain(), None, None).at(Setting({"p": 0.5}), plain())
    assert (found.psnr, found.training_distance, found.neighbours) == (None, None, 0)
    assert found.sentence == "nothing like it was measured"


def test_what_is_said_is_json(ensemble: tuple[Surrogate, Catalog], known: Expectation) -> None:
    surrogate, _ = ensemble
    said = known.at(Setting({"p": 0.5}, {"isovalue": 3.0}), surrogate).to_json()
    assert json.loads(json.dumps(said, allow_nan=False))["sentence"] == said["sentence"]
    assert said["warning"] is False


def test_a_lookup_is_fast() -> None:
    rows = [measured("train", p, 40.0) for p in np.linspace(0.0, 1.0, 220)]
    expectation, setting = expected(rows, following()), Setting({"p": 0.5}, {"c1_value": 0.1})
    expectation.at(setting, following())
    surrogate, times = following(), []
    for _ in range(50):
        started = perf_counter()
        expectation.at(setting, surrogate)
        times.append(perf_counter() - started)
    assert min(times) < 1e-3


# ---- measuring


def test_nothing_that_tests_is_looked_at(ensemble: tuple[Surrogate, Catalog]) -> None:
    surrogate, catalog = ensemble
    tested = {s.appearance for v in surrogate.visualizations for s in v.variation.settings if s.split == "test"}
    cases = places_of(surrogate, catalog.members)
    assert cases
    assert not tested & {case.appearance for case in cases}
    for case in cases:
        assert case.member.split != "test"
        assert {case.member.view_splits[view] for view in case.views} == {"validation"}  # view 2, never 3 and 4
        assert len(case.views) <= VIEWS
    kinds = {(case.member.split, tuple(case.varied)) for case in cases}
    assert {("validation", ()), ("train", ()), ("train", ("isovalue",)), ("validation", ("isovalue",))} <= kinds


def test_views_that_were_learnt_stand_in_for_validation_members_only(ensemble: tuple[Surrogate, Catalog]) -> None:
    surrogate, catalog = ensemble
    blind = [replace(m, view_splits=("train", "train", "train", "test", "test")) for m in catalog.members]
    cases = places_of(surrogate, blind)
    assert {case.member.split for case in cases} == {"validation"}
    assert all(case.seen_views for case in cases)


def test_every_setting_is_measured_before_any_is_twice(
    ensemble: tuple[Surrogate, Catalog], monkeypatch: pytest.MonkeyPatch
) -> None:
    surrogate, catalog = ensemble
    monkeypatch.setattr(module, "MOST_VARIED", 9)
    trained = [
        replace(m, name=f"train-{i}", appearances=catalog.members[1].appearances) for i, m in enumerate(catalog.members)
    ]
    cases = places_of(surrogate, [replace(m, split="train") for m in trained])
    varied = [case for case in cases if case.varied]
    assert len({case.appearance for case in varied}) == len(varied) == 9
    assert len({case.member.name for case in varied}) > 1


def test_a_perfect_surrogate_is_expected_to_be_perfect(ensemble: tuple[Surrogate, Catalog], known: Expectation) -> None:
    surrogate, _ = ensemble
    found = known.at(Setting({"p": 0.5}, {"isovalue": 2.0}), surrogate)
    assert found.psnr is not None
    assert 45.0 < found.psnr <= MOST_DECIBELS  # eight bits
    assert not found.seen_views


def test_it_is_measured_once(ensemble: tuple[Surrogate, Catalog], tmp_path: Path) -> None:
    surrogate, catalog = ensemble
    steps: list[tuple[int, int]] = []
    first = measure(surrogate, catalog, tmp_path, lambda _, done, total: steps.append((done, total)))
    assert steps[-1][0] == steps[-1][1] == len(steps) > 0
    again = measure(surrogate, catalog, tmp_path, lambda *_: pytest.fail("measured again"))
    assert again.measured == first.measured
    assert [path.name for path in (tmp_path / FILE).parent.iterdir()] == [FILE.name]


def test_after_training_anew_it_is_measured_anew(ensemble: tuple[Surrogate, Catalog], tmp_path: Path) -> None:
    surrogate, catalog = ensemble
    measure(surrogate, catalog, tmp_path)
    gaussians = replace(surrogate.gaussians, opacity_logits=surrogate.gaussians.opacity_logits - 3.0)
    faded = replace(surrogate, gaussians=gaussians)
    found, before = (measure(one, catalog, tmp_path).at(Setting({"p": 0.5}), one).psnr for one in (faded, surrogate))
    assert found is not None
    assert before is not None
    assert found < before - 10.0


def test_the_mark_is_of_numbers_and_members(ensemble: tuple[Surrogate, Catalog]) -> None:
    surrogate, catalog = ensemble
    members = catalog.members
    mark = fingerprint(surrogate, members)
    assert fingerprint(surrogate, catalog.members) == mark
    assert fingerprint(surrogate, members[1:]) != mark
    moved = replace(surrogate.gaussians, means=surrogate.gaussians.means + 1e-6)
    assert fingerprint(replace(surrogate, gaussians=moved), members) != mark


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b"null", b'{"fingerprint": "other", "measured": []}', b"\xff\xfe", b'{"fingerprint": 1}'],
)
def test_a_damaged_file_is_measured_anew(ensemble: tuple[Surrogate, Catalog], tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE).parent.mkdir()
    (tmp_path / FILE).write_bytes(content)
    assert measure(*ensemble, tmp_path).measured
    assert json.loads((tmp_path / FILE).read_text())["measured"]


def test_wrong_measurements_under_the_right_mark_are_made_anew(
    ensemble: tuple[Surrogate, Catalog], tmp_path: Path
) -> None:
    before = measure(*ensemble, tmp_path).measured
    record = json.loads((tmp_path / FILE).read_text())
    record["measured"][0]["psnr"] = ["nan"]
    (tmp_path / FILE).write_text(json.dumps(record))
    assert measure(*ensemble, tmp_path).measured == before


def test_a_run_that_can_not_be_written_is_measured_in_memory(
    ensemble: tuple[Surrogate, Catalog], tmp_path: Path
) -> None:
    (tmp_path / FILE.parent).write_text("a file where the folder should be")
    assert measure(*ensemble, tmp_path).measured


def test_an_interruption_leaves_nothing(ensemble: tuple[Surrogate, Catalog], tmp_path: Path) -> None:
    def stop(_: str, done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(*ensemble, tmp_path, stop)
    assert not (tmp_path / FILE.parent).exists()


def test_pictures_that_are_gone_are_left_out(ensemble: tuple[Surrogate, Catalog], tmp_path: Path) -> None:
    surrogate, catalog = ensemble
    copy = Catalog.open(shutil.copytree(catalog.path, tmp_path / "copy.cdb"))
    for path in (copy.path / "members" / "validation-0").glob("*/*.png"):
        path.unlink()
    assert {one.split for one in measure(surrogate, copy, None).measured} == {"train"}


def test_a_catalog_of_other_parameters_is_refused(ensemble: tuple[Surrogate, Catalog]) -> None:
    surrogate, catalog = ensemble
    parameters = [{**record, "name": "q"} for record in surrogate.space.to_json()]
    with pytest.raises(ValueError, match="catalog is of"):
        measure(replace(surrogate, space=type(surrogate.space).from_json(parameters)), catalog, None)
