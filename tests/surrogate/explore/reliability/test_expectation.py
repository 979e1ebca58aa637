"""Expectations come from the nearest measurements, and state how far they can be trusted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera
from surrogate.evaluation.metrics import MOST_DECIBELS
from surrogate.evaluation.novelty import SeenValues
from surrogate.explore.reliability.calibration import NEAREST
from surrogate.explore.reliability.expectation import NEW, Expectation, measure
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.rasterizer import Rasterizer
from tests.support.field_blobs import FUNCTION, field_catalog
from tests.support.measured import expected, measured
from tests.support.models import following, plain
from tests.support.varied_blobs import BLOBS, varied_catalog, varied_surrogate

CORNERS = ({}, {"c1_value": -0.4}, {"c1_value": 0.4})  # between which functions are measured


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A surrogate that predicts its own catalog exactly, but for the bits of its pictures."""
    surrogate = replace(varied_surrogate(), rasterizer=Rasterizer(backend="cpu"))
    catalog = varied_catalog(tmp_path_factory.mktemp("expectation") / "varied.cdb", surrogate)
    return Run("varied", surrogate, catalog=catalog)


@pytest.fixture(scope="module")
def known(ensemble: Run) -> Expectation:
    return measure(ensemble)


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


def test_an_isosurface_is_expected_from_isosurfaces() -> None:
    rows = [measured("validation", 0.5, 50.0), measured("validation", 0.5, 30.0, varied={"isovalue": 0.4})]
    expectation = expected(rows, following())
    assert expectation.at(Setting({"p": 0.5}, {"isovalue": 0.4}), following()).psnr == 30.0
    assert expectation.at(Setting({"p": 0.5}), following()).psnr == 50.0


def test_a_perfect_surrogate_is_expected_to_be_perfect(ensemble: Run, known: Expectation) -> None:
    surrogate = ensemble.surrogate
    found = known.at(Setting({"p": 0.5}, {"isovalue": 2.0}), surrogate)
    assert found.psnr is not None
    assert 45.0 < found.psnr <= MOST_DECIBELS  # eight bits
    assert not found.seen_views


# ---- where there is no number


ROWS = [measured("validation", p, 40.0 - 10.0 * p) for p in (0.0, 0.2, 0.5)]
VARIED = [measured("validation", p, 35.0, varied={"c1_value": v}) for p, v in ((0.0, -0.2), (0.4, 0.3), (0.6, 0.1))]
SURFACES = [measured("validation", p, 30.0, varied={"isovalue": v}) for p, v in ((0.1, 0.3), (0.3, 0.5))]


@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        (Setting({"p": 0.1}), ""),
        (Setting({"p": 0.8}), ""),  # as far from 0.5 as 0.2 is
        (Setting({"p": 0.81}), "too far from any measured setting"),
        (Setting({"p": 1.2}), "p outside the measured range"),
        (Setting({"p": -1e-6}), "p outside the measured range"),
        (Setting({"p": 0.1}, {"isovalue": 0.4}), "no similar image was measured"),
        (Setting({"p": 0.1}, {"c1_value": 0.1}), "transfer function outside the measured range"),
        (Setting({"p": 0.1}, {"c1_opacity": 0.28}), "c1 opacity outside the measured range"),
        (Setting({"p": 0.1}, {}, "viridis"), "colours outside the measured range"),
    ],
)
def test_a_number_is_given_only_where_the_like_was_measured(setting: Setting, reason: str) -> None:
    found = expected(ROWS, following()).at(setting, following())
    assert (found.psnr is None) == bool(reason)
    assert ("dB" in found.short) == (not reason)
    assert reason in found.short
    assert found.warning == bool(reason)


def test_ways_to_show_the_field_are_measured_between_those_that_were(ensemble: Run) -> None:
    expectation = expected([*ROWS, *VARIED, *SURFACES], following())
    for visualization, inside in (
        ({"c1_value": 0.2}, True),
        ({"c1_value": 0.31}, False),
        ({"c1_value": 0.2, "c2_value": 0.01}, False),
        ({"isovalue": 0.4}, True),
        ({"isovalue": 0.6}, False),
    ):
        found = expectation.at(Setting({"p": 0.3}, visualization), following())
        assert (found.psnr is not None) == inside, visualization


def looking(distance: float, *, field: float = 32.0, target: tuple[float, float, float] = (0, 0, 0)) -> Camera:
    """From the direction of a stored camera."""
    direction = BLOBS.cameras()[0].position / 5.0
    position = np.array(target) + distance * direction
    return Camera.look_at(position, target, vertical_fov_degrees=field, width=60, height=24)


@pytest.mark.parametrize(
    ("camera", "reason"),
    [
        (looking(5.0), ""),
        (looking(4.5), ""),
        (looking(4.0), "camera outside the measured range"),
        (looking(0.5), "camera outside the measured range"),
        (looking(7.0), "camera outside the measured range"),
        (looking(5.0, field=10.0), "camera outside the measured range"),
        (looking(5.0, field=60.0), "camera outside the measured range"),
        (looking(5.0, target=(0.0, 0.0, 1.0)), "camera outside the measured range"),
        (
            Camera.look_at((0, 0, 5), (0, 0, 9), vertical_fov_degrees=32, width=24, height=24),
            "camera outside the measured range",
        ),
    ],
)
def test_no_number_is_given_from_where_no_stored_camera_looks(
    ensemble: Run, known: Expectation, camera: Camera, reason: str
) -> None:
    found = known.at(Setting({"p": 0.25}), ensemble.surrogate, camera)
    assert (found.psnr is None) == bool(reason), found.short
    assert reason in found.short


def test_numbers_tell_the_truth_inside_and_are_silent_outside() -> None:
    """A surrogate whose error grows from 40 dB by 10 dB a width, also outside; measured at seven places."""
    rows = [measured("validation", p, 40.0 - 10.0 * p) for p in np.linspace(0.05, 0.95, 7)]
    expectation, inside = expected(rows), []
    for p in np.linspace(-0.9, 1.9, 57):
        found = expectation.at(Setting({"p": float(p)}), plain())
        if found.psnr is not None:
            inside.append(float(p))
            assert found.error is not None
            assert abs(found.psnr - (40.0 - 10.0 * p)) <= 2.5 * found.error
    assert -1e-9 <= min(inside) < 0.06
    assert 0.94 < max(inside) <= 1.0 + 1e-9


# ---- what is said


def test_the_sentence_names_the_nearest_training_member(ensemble: Run, known: Expectation) -> None:
    surrogate = ensemble.surrogate  # trained at 0 and 1
    found = known.at(Setting({"p": 0.25}), surrogate)
    assert found.training_distance == pytest.approx(0.25)
    assert not found.far
    assert not found.warning
    assert found.sentence.endswith("; nearest training member train-0 (p 0)")
    assert found.sentence.startswith("expected PSNR ")
    assert "higher is better" in found.sentence


def test_far_from_training_and_out_of_bounds_warn(ensemble: Run, known: Expectation) -> None:
    surrogate = ensemble.surrogate
    found = known.at(Setting({"p": 2.5}), surrogate)
    assert found.far
    assert found.warning
    assert found.sentence.startswith(
        "not measured here: p outside the measured range; nearest training member train-1 (p 1)"
    )
    assert "farther away than training members from each other" in found.sentence


def test_without_pictures_kept_from_training_it_says_so(ensemble: Run) -> None:
    only = [member for member in ensemble.members if member.split == "train"]
    found = Expectation.of([], ensemble.surrogate, only).at(Setting({"p": 0.5}), ensemble.surrogate)
    assert found.short == "not measured here: no similar image was measured"
    assert found.training_member == "train-0 (p 0)"


def test_nothing_is_expected_of_colours_that_were_never_trained() -> None:
    found = expected([measured("validation", 0.5, 50.0)], following()).at(
        Setting({"p": 0.5}, {}, "viridis"), following()
    )
    assert found.psnr is None
    assert found.warning
    assert "colours" in found.sentence


def test_nothing_is_expected_where_training_never_showed_the_values_that_a_function_shows() -> None:
    surrogate, rows = following(), [measured("train", p, 40.0, varied=places) for p in (0.0, 1.0) for places in CORNERS]
    known = expected(rows, surrogate)
    edges = np.linspace(*FUNCTION.bounds, 4)  # thirds
    everywhere, at_base = Setting({"p": 0.5}, {"c1_value": 0.1}), Setting({"p": 0.5})
    for shown, new in (((1.0, 1.0, 1.0), 0.0), ((0.0, 1.0, 1.0), None), ((0.0, 0.0, 1e-6), None)):
        seen = SeenValues(edges, np.full(3, 1 / 3), 10.0 * np.array(shown))
        there = replace(known, seen_values=seen)
        share = seen.novelty(everywhere.transfer_function(surrogate))
        found = there.at(everywhere, surrogate)
        assert there.at(at_base, surrogate).psnr == 40.0  # the base is what was trained, whatever it shows
        if new == 0.0:
            assert (share, found.psnr) == (0.0, 40.0)
        else:
            assert share > NEW
            assert found.psnr is None
            assert found.unmeasured == "transfer function outside the measured range"
    assert known.at(everywhere, surrogate).psnr == 40.0  # where nothing is known of values, distances alone decide


def test_a_run_knows_what_its_training_showed(tmp_path: Path) -> None:
    run = Run("fields", following(), catalog=field_catalog(tmp_path / "a.cdb", summaries=True))
    assert measure(run).seen_values is not None
    assert measure(Run("alone", plain())).seen_values is None


def test_nothing_is_expected_without_a_catalog() -> None:
    found = measure(Run("alone", plain())).at(Setting({"p": 0.5}), plain())
    assert (found.psnr, found.training_distance, found.neighbours) == (None, None, 0)
    assert found.sentence == "not measured here: no similar image was measured"


def test_what_is_said_is_json(ensemble: Run, known: Expectation) -> None:
    surrogate = ensemble.surrogate
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
