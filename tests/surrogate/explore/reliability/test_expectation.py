"""What is expected comes from the nearest measurements, and says how far it can be trusted."""

from __future__ import annotations

import json
from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest

from surrogate.evaluation.metrics import MOST_DECIBELS
from surrogate.explore.reliability.calibration import NEAREST
from surrogate.explore.reliability.expectation import Expectation, measure
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.rasterizer import Rasterizer
from tests.support.measured import expected, measured
from tests.support.models import following, plain
from tests.support.varied_blobs import varied_catalog, varied_surrogate


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
    assert expectation.at(Setting({"p": 0.5}, {"isovalue": 0.7}), following()).psnr == 30.0
    assert expectation.at(Setting({"p": 0.5}, {"c1_value": 0.1}), following()).psnr == 50.0


def test_a_perfect_surrogate_is_expected_to_be_perfect(ensemble: Run, known: Expectation) -> None:
    surrogate = ensemble.surrogate
    found = known.at(Setting({"p": 0.5}, {"isovalue": 2.0}), surrogate)
    assert found.psnr is not None
    assert 45.0 < found.psnr <= MOST_DECIBELS  # eight bits
    assert not found.seen_views


# ---- what is said


def test_the_sentence_says_how_far_the_nearest_training_member_is(ensemble: Run, known: Expectation) -> None:
    surrogate = ensemble.surrogate  # trained at 0 and 1
    found = known.at(Setting({"p": 0.25}), surrogate)
    assert found.training_distance == pytest.approx(0.25)
    assert found.training_spacing == pytest.approx(1.0)
    assert not found.far
    assert not found.warning
    assert "nearest training member 0.25 of the range away" in found.sentence
    assert found.sentence.startswith("expected ")


def test_far_from_training_and_out_of_bounds_warn(ensemble: Run, known: Expectation) -> None:
    surrogate = ensemble.surrogate
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
    found = measure(Run("alone", plain())).at(Setting({"p": 0.5}), plain())
    assert (found.psnr, found.training_distance, found.neighbours) == (None, None, 0)
    assert found.sentence == "nothing like it was measured"


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
