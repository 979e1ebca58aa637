"""Expectations all over the parameters agree with what the doubt says where it is asked."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from surrogate.answers.doubt import Doubt
from surrogate.answers.survey import FILE, POINTS, Expectation, Survey
from surrogate.explore.run import Run
from tests.support.accelerating import run_in


def test_an_expectation_finds_slopes_and_what_they_leave() -> None:
    random = np.random.default_rng(0)
    points = random.uniform(-1, 1, (128, 2))

    def open_shares(point: np.ndarray) -> np.ndarray:
        return np.exp(-3.0 - np.stack([2.0 * point[..., 0] ** 2, np.cos(3.0 * point[..., 1])], -1))

    def true(point: np.ndarray) -> np.ndarray:
        first, second = np.moveaxis(np.log(open_shares(point)), -1, 0)
        return 30.0 - 2.0 * first + 0.5 * second + 0.3 * np.sin(2 * point[..., 0])

    one = Expectation.of(points, open_shares(points), true(points), 3.0, 0.89, "8 validation members")
    assert one.slopes == pytest.approx([-2.0, 0.5], abs=0.2)
    for _ in range(20):
        point = random.uniform(-0.9, 0.9, 2)
        assert one.at(point, open_shares(point)) == pytest.approx(true(point), abs=0.02)
    assert 3.0 <= one.half < 3.02  # it is hardly off
    again = Expectation.from_json(json.loads(json.dumps(one.to_json())))
    assert again.at(points[0], open_shares(points[0])) == pytest.approx(one.at(points[0], open_shares(points[0])))


def test_what_is_off_between_points_widens_the_interval() -> None:
    random = np.random.default_rng(0)
    points, shares = random.uniform(-1, 1, (128, 2)), np.full((128, 1), 0.5)
    noisy = Expectation.of(points, shares, random.normal(30.0, 2.0, 128), 3.0, 0.89, "")
    assert noisy.half == pytest.approx(np.hypot(3.0, 2.0 * 1.64), rel=0.2)  # 90 % of a normal distribution


def test_an_expectation_may_be_the_same_everywhere() -> None:
    points, shares = np.random.default_rng(0).uniform(-1, 1, (128, 3)), np.full((128, 1), 0.5)
    one = Expectation.of(points, shares, np.full(128, 37.0), 3.0, 0.89, "")
    assert one.at(points[0], shares[0]) == pytest.approx(37.0, abs=1e-6)
    assert one.half == pytest.approx(3.0, abs=1e-6)


@pytest.mark.slow
def test_a_survey_says_about_what_the_doubt_says(tmp_path: Path) -> None:
    run = Run.open(run_in(tmp_path))
    assert run.catalog is not None
    catalog, doubt = run.catalog, Doubt.of(run.surrogate, run.catalog)
    cameras, space, counts = run.cameras, doubt.surrogate.space, []
    survey = Survey.of(doubt, catalog, cameras, tmp_path, lambda *one: counts.append(one))
    assert counts[-1][1:] == (POINTS, POINTS)
    random, off = np.random.default_rng(1), []
    for _ in range(30):
        point = random.uniform(-1, 1, len(space))
        parameters = dict(zip(space.names, space.denormalize(point).tolist(), strict=True))
        asked = doubt.at(parameters, using="field").interval(cameras[0])
        assert asked.psnr is not None
        off.append(abs(survey.expected(point, "field") - asked.psnr))
    assert np.std([survey.expected(np.array([p]), "field") for p in np.linspace(-1, 1, 9)]) > 0.5  # it varies
    half, calibrated = survey.expectations["field"].half, doubt.calibrations["view field"].half
    assert np.quantile(off, 0.8) <= np.sqrt(half**2 - calibrated**2)
    with pytest.raises(KeyError):  # there are none
        survey.expected(np.zeros(len(space)), "gaussians")

    counts.clear()
    again = Survey.of(doubt, catalog, cameras, tmp_path, lambda *one: counts.append(one))
    assert counts == []  # it was kept
    point = np.full(len(space), 0.3)
    assert again.expected(point, "field") == survey.expected(point, "field")
    (tmp_path / FILE).write_text((tmp_path / FILE).read_text().replace('"slopes"', '"slops"'))
    Survey.of(doubt, catalog, cameras, tmp_path, lambda *one: counts.append(one))
    assert counts  # damage is measured anew
