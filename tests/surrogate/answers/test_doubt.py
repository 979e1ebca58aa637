"""Intervals of pictures' PSNR, calibrated by members that were left out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.files.images import read_image
from catalogs.store.catalog import Catalog
from surrogate.answers.doubt import BETWEEN, FAR, FILE, LIKE, NEVER, Doubt, Interval
from surrogate.answers.maps import error_map
from surrogate.answers.unseen import of_emulator
from surrogate.cli import main
from surrogate.evaluation.metrics import WHITE, composite, psnr
from surrogate.explore.run import Run
from surrogate.model import Surrogate
from surrogate.training.run import train
from tests.support.accelerating import run_in
from tests.support.finished_runs import SETTINGS
from tests.support.hooked import FUNCTION


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose catalog lies beside its surrogate."""
    return run_in(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def catalog(folder: Path) -> Catalog:
    return Catalog.open(folder / "catalog.cdb")


@pytest.fixture(scope="module")
def surrogate(folder: Path) -> Surrogate:
    return Surrogate.load(folder / "surrogate")


@pytest.fixture(scope="module")
def doubt(folder: Path, surrogate: Surrogate, catalog: Catalog) -> Doubt:
    return Doubt.of(surrogate, catalog, folder)


def test_intervals_hold_for_members_of_the_test(doubt: Doubt, surrogate: Surrogate, catalog: Catalog) -> None:
    inside, expected, true = [], [], []
    for member in (m for m in catalog.members if m.split == "test"):
        camera = member.cameras[5]
        interval = doubt.interval(member.parameters, camera)
        picture = composite(surrogate.at(member.parameters).render(camera), WHITE)
        truth = psnr(composite(catalog.image(member, "dvr", 5), WHITE), picture)
        assert interval.low is not None
        assert interval.high is not None
        inside.append(interval.low <= truth <= interval.high)
        expected.append(interval.psnr)
        true.append(truth)
    assert np.mean(inside) >= 0.75  # of 90 % promised, eight members
    assert np.corrcoef(expected, true)[0, 1] > 0.6  # it knows where it is hard


def test_what_calibrates_is_predicted_without_itself(surrogate: Surrogate, catalog: Catalog) -> None:
    assert surrogate.field is not None
    left_out = [*of_emulator(surrogate.field, catalog, lambda *_: None)]
    learnt = {m.name: m for m in catalog.members if m.split in surrogate.field.splits}
    assert {one.member for one in left_out} == set(learnt)
    seen = []
    for one in left_out:
        member = learnt[one.member]
        picture = composite(surrogate.at(member.parameters).render(member.cameras[0]), WHITE)
        seen.append(psnr(composite(catalog.image(member, "dvr", 0), WHITE), picture))
    assert np.mean([one.truth for one in left_out]) < np.mean(seen) - 2.0


def test_words_tell_runs_from_what_lies_between_and_outside(doubt: Doubt, catalog: Catalog) -> None:
    learnt = next(m for m in catalog.members if m.split == "train")
    assert doubt.at(learnt.parameters).words == LIKE
    assert {doubt.at({"p": p}).words for p in np.linspace(0.01, 0.99, 40)} <= {LIKE, BETWEEN, FAR}
    outside = doubt.interval({"p": 1.4}, learnt.cameras[0])
    assert (outside.words, outside.psnr) == (NEVER, None)
    assert "p" in outside.why


def test_other_functions_are_doubted_and_new_ones_get_no_number(doubt: Doubt, catalog: Catalog) -> None:
    camera = catalog.members[0].cameras[0]
    points = [(value, 0.5 * opacity) for value, opacity in FUNCTION.opacity_points]
    fainter = replace(FUNCTION, opacity_points=tuple(points))
    under = doubt.interval({"p": 0.3}, camera, fainter)
    assert under.psnr is not None
    assert under.psnr > (doubt.interval({"p": 0.3}, camera).psnr or 0.0)  # of less that is seen, less can be wrong
    ends = [FUNCTION.opacity_points[0][0], FUNCTION.opacity_points[-1][0]]
    everything = replace(FUNCTION, opacity_points=tuple((value, 0.9) for value in ends))
    assert doubt.interval({"p": 0.3}, camera, everything).words == NEVER


def test_a_record_is_used_again_and_a_damaged_one_is_not(
    doubt: Doubt, folder: Path, surrogate: Surrogate, catalog: Catalog, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = "surrogate.answers.doubt.calibrations_of"
    path = folder / FILE
    with monkeypatch.context() as patched:
        patched.setattr(measured, lambda *_: pytest.fail("measured again"))
        assert Doubt.of(surrogate, catalog, folder).calibrations == doubt.calibrations
    whole = path.read_bytes()
    record = json.loads(whole)
    record["values"]["calibrations"]["view field"]["half"] = "wide"
    path.write_text(json.dumps(record))
    assert Doubt.of(surrogate, catalog, folder).calibrations == doubt.calibrations
    assert json.loads(path.read_bytes())["values"] == json.loads(whole)["values"]


def test_maps_rank_pixels_by_their_errors(doubt: Doubt, surrogate: Surrogate, catalog: Catalog) -> None:
    ranks = []
    for member in (m for m in catalog.members if m.split == "test"):
        camera = member.cameras[3]
        errors = error_map(doubt, member.parameters, camera)
        assert errors.shape == (32, 32)
        assert errors.min() >= 0.0
        truth = composite(catalog.image(member, "dvr", 3), WHITE)
        wrong = np.abs(composite(surrogate.at(member.parameters).render(camera), WHITE) - truth).mean(-1)
        ranks.append(np.corrcoef(errors.ravel(), wrong.ravel())[0, 1])
    assert np.mean(ranks) > 0.5


def test_the_command_answers_in_words_json_and_a_picture(doubt: Doubt, folder: Path, tmp_path: Path) -> None:
    def asked(*options: str) -> str:
        result = CliRunner().invoke(main, ["ask", "sure", str(folder), *options])
        assert result.exception is None or result.exit_code == 1, result.output
        return result.output

    camera = Run.open(folder).cameras[2]
    expected = doubt.interval({"p": 0.3}, camera)
    assert expected.sentence in asked("-p", "p=0.3", "--view", "2")
    output = tmp_path / "map.png"
    answer = asked("-p", "p=0.3", "--view", "2", "--json", "-o", str(output))
    assert json.loads(answer[: answer.rindex("}") + 1]) == expected.to_json()
    assert min(read_image(output).shape[:2]) > 300
    assert "p takes NAME=VALUE" in asked("-p", "p")
    assert "--view must be below" in asked("-p", "p=0.3", "--view", "99")


@pytest.fixture(scope="module")
def trained(catalog: Catalog, tmp_path_factory: pytest.TempPathFactory) -> Surrogate:
    """The same with Gaussians."""
    return train(SETTINGS, catalog, tmp_path_factory.mktemp("trained") / "surrogate")


@pytest.mark.slow
def test_gaussians_without_a_field_doubt_by_other_embeddings(catalog: Catalog, trained: Surrogate) -> None:
    surrogate = replace(trained, field=None)
    doubt = Doubt.of(surrogate, catalog)
    assert set(doubt.calibrations) == {"view gaussians"}
    camera = catalog.members[0].cameras[5]
    interval = doubt.interval({"p": 0.3}, camera)
    assert interval.words in (LIKE, BETWEEN)
    assert interval.source == "4 validation members"
    assert interval.low is not None
    assert error_map(doubt, {"p": 0.3}, camera).shape == (32, 32)
    assert doubt.interval({"p": 1.4}, camera).words == NEVER


def test_no_number_is_given_from_where_no_image_looks(doubt: Doubt, catalog: Catalog) -> None:
    camera = catalog.members[0].cameras[5]
    near = doubt.interval({"p": 0.3}, replace(camera, fx=4.0 * camera.fx, fy=4.0 * camera.fy))
    assert (near.words, near.psnr, near.why) == (NEVER, None, "no stored image looks from there")


@pytest.mark.slow
def test_gaussians_doubt_by_their_difference_from_the_field(catalog: Catalog, trained: Surrogate) -> None:
    surrogate = trained
    doubt = Doubt.of(surrogate, catalog)
    assert {"view field", "view gaussians", "view both"} <= set(doubt.calibrations)
    drawn = replace(doubt, surrogate=surrogate.using("both"))
    interval = drawn.interval({"p": 0.3}, catalog.members[0].cameras[0])
    assert interval.source == "4 validation members"
    assert interval.share == pytest.approx(0.8)  # four of five


def test_neither_gaussians_nor_a_field_is_nobody_to_ask(catalog: Catalog, surrogate: Surrogate) -> None:
    with pytest.raises(ValueError, match="fewer than four members"):
        Doubt.of(replace(surrogate, field=None), catalog)


@pytest.mark.parametrize(
    ("numbers", "short", "sentence"),
    [
        ((45.7, 40.8, 50.6), "PSNR 45.7 dB (40.8 to 50.6 dB)", "PSNR 45.7 dB, 40.8 to 50.6 dB in 90%"),
        ((58.0, 55.0, 60.0), "PSNR 58.0 dB (55.0 dB or more)", "PSNR 58.0 dB, 55.0 dB or more in 90%"),
        ((60.0, 58.5, 60.0), "PSNR 60 dB or more (58.5 dB or more)", "PSNR 60 dB or more, 58.5 dB or more in 90%"),
        ((60.0, 60.0, 60.0), "PSNR 60 dB or more", "PSNR 60 dB or more in 90%"),
    ],
    ids=str,
)
def test_the_most_that_is_counted_reads_as_more(numbers: tuple[float, float, float], short: str, sentence: str) -> None:
    one = Interval(BETWEEN, *numbers, share=0.9, source="8 validation members")
    assert one.short == f"between runs: {short}"
    assert one.sentence == f"between runs: {sentence} of such pictures (calibrated by 8 validation members)"
