"""The surrogate is measured at what it did not learn from, never at what tests it, and once."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from catalogs.store.catalog import Catalog
from surrogate import Surrogate
from surrogate.explore.reliability import measuring as module
from surrogate.explore.reliability.expectation import measure
from surrogate.explore.reliability.measuring import FILE, VIEWS, cases_of, key_of, measurements
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.rasterizer import Rasterizer
from tests.support.varied_blobs import varied_catalog, varied_surrogate


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A surrogate that predicts its own catalog exactly, but for the bits of its pictures."""
    surrogate = replace(varied_surrogate(), rasterizer=Rasterizer(backend="cpu"))
    catalog = varied_catalog(tmp_path_factory.mktemp("expectation") / "varied.cdb", surrogate)
    return Run("varied", surrogate, catalog=catalog)


def test_nothing_that_tests_is_looked_at(ensemble: Run) -> None:
    tested = {
        s.appearance for v in ensemble.surrogate.visualizations for s in v.variation.settings if s.split == "test"
    }
    cases = cases_of(ensemble.surrogate, ensemble.members)
    assert cases
    assert not tested & {case.appearance for case in cases}
    for case in cases:
        assert case.member.split != "test"
        assert {case.member.view_splits[view] for view in case.views} == {"validation"}  # view 2, never 3 and 4
        assert len(case.views) <= VIEWS
    kinds = {(case.member.split, tuple(case.varied)) for case in cases}
    assert {("validation", ()), ("train", ()), ("train", ("isovalue",)), ("validation", ("isovalue",))} <= kinds


def test_views_that_were_learnt_stand_in_for_validation_members_only(ensemble: Run) -> None:
    blind = [replace(m, view_splits=("train", "train", "train", "test", "test")) for m in ensemble.members]
    cases = cases_of(ensemble.surrogate, blind)
    assert {case.member.split for case in cases} == {"validation"}
    assert all(case.seen_views for case in cases)


def test_every_setting_is_measured_before_any_is_twice(ensemble: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_VARIED", 9)
    trained = [
        replace(m, name=f"train-{i}", appearances=ensemble.members[1].appearances)
        for i, m in enumerate(ensemble.members)
    ]
    cases = cases_of(ensemble.surrogate, [replace(m, split="train") for m in trained])
    varied = [case for case in cases if case.varied]
    assert len({case.appearance for case in varied}) == len(varied) == 9
    assert len({case.member.name for case in varied}) > 1


def test_it_is_measured_once(ensemble: Run, tmp_path: Path) -> None:
    run = replace(ensemble, folder=tmp_path)
    steps: list[tuple[int, int]] = []
    first = measurements(run, lambda _, done, total: steps.append((done, total)))
    assert steps[-1][0] == steps[-1][1] == len(steps) > 0
    assert measurements(run, lambda *_: pytest.fail("measured again")) == first
    assert [path.name for path in (tmp_path / FILE).parent.iterdir()] == [FILE.name]
    provenance = json.loads((tmp_path / FILE).read_text())["provenance"]
    assert provenance["processor_seconds"] > 0
    assert provenance["commit"]


def test_after_training_anew_it_is_measured_anew(ensemble: Run, tmp_path: Path) -> None:
    run = replace(ensemble, folder=tmp_path)
    measurements(run)
    faded = replace(run.surrogate.gaussians, opacity_logits=run.surrogate.gaussians.opacity_logits - 3.0)
    anew = replace(run, surrogate=replace(run.surrogate, gaussians=faded))
    found, before = (measure(one).at(Setting({"p": 0.5}), one.surrogate).psnr for one in (anew, run))
    assert found is not None
    assert before is not None
    assert found < before - 10.0


def test_the_key_is_of_numbers_and_members(ensemble: Run) -> None:
    class Fewer(Run):
        @property
        def members(self) -> Any:
            return ensemble.members[1:]

    key, surrogate = key_of(ensemble), ensemble.surrogate
    assert key_of(replace(ensemble, catalog=Catalog.open(ensemble.catalog.path))) == key  # type: ignore[union-attr]
    assert key_of(Fewer("fewer", surrogate, catalog=ensemble.catalog)) != key
    moved = replace(surrogate.gaussians, means=surrogate.gaussians.means + 1e-6)
    assert key_of(replace(ensemble, surrogate=replace(surrogate, gaussians=moved))) != key


def test_the_key_survives_saving(ensemble: Run, tmp_path: Path) -> None:
    ensemble.surrogate.save(tmp_path)
    assert key_of(replace(ensemble, surrogate=Surrogate.load(tmp_path))) == key_of(ensemble)


EARLIER = {  # the layout before records
    "version": 1,
    "fingerprint": "0" * 64,
    "measured": [
        {
            "member": "validation-0",
            "split": "validation",
            "parameters": {"p": 0.25},
            "appearance": "dvr",
            "varied": {},
            "psnr": [40.0],
            "seen_views": False,
        }
    ],
}


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b'{"fingerprint": "other", "measured": []}',
        b"\xff\xfe",
        b'{"fingerprint": 1}',
        json.dumps(EARLIER).encode(),
    ],
)
def test_a_file_that_is_damaged_or_of_an_earlier_layout_is_measured_anew(
    ensemble: Run, tmp_path: Path, content: bytes
) -> None:
    (tmp_path / FILE).parent.mkdir()
    (tmp_path / FILE).write_bytes(content)
    found = measurements(replace(ensemble, folder=tmp_path))
    assert len(found) > 1
    assert len(json.loads((tmp_path / FILE).read_text())["values"]["measured"]) == len(found)


def test_wrong_measurements_under_the_right_key_are_made_anew(ensemble: Run, tmp_path: Path) -> None:
    run = replace(ensemble, folder=tmp_path)
    before = measurements(run)
    record = json.loads((tmp_path / FILE).read_text())
    record["values"]["measured"][0]["psnr"] = ["nan"]
    (tmp_path / FILE).write_text(json.dumps(record))
    assert measurements(run) == before


def test_a_run_that_can_not_be_written_is_measured_in_memory(ensemble: Run, tmp_path: Path) -> None:
    (tmp_path / FILE.parent).write_text("a file where the folder should be")
    assert measurements(replace(ensemble, folder=tmp_path))


def test_an_interruption_leaves_nothing(ensemble: Run, tmp_path: Path) -> None:
    def stop(_: str, done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measurements(replace(ensemble, folder=tmp_path), stop)
    assert not (tmp_path / FILE.parent).exists()


def test_pictures_that_are_gone_are_left_out(ensemble: Run, tmp_path: Path) -> None:
    assert ensemble.catalog is not None
    copy = Catalog.open(shutil.copytree(ensemble.catalog.path, tmp_path / "copy.cdb"))
    for path in (copy.path / "members" / "validation-0").glob("*/*.png"):
        path.unlink()
    assert {one.split for one in measurements(replace(ensemble, catalog=copy))} == {"train"}


def test_a_catalog_of_other_parameters_is_refused(ensemble: Run) -> None:
    space = ensemble.surrogate.space
    other = type(space).from_json([{**record, "name": "q"} for record in space.to_json()])
    with pytest.raises(ValueError, match="catalog is of"):
        measure(replace(ensemble, surrogate=replace(ensemble.surrogate, space=other)))
