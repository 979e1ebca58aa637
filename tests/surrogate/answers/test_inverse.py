"""Parameters are read back from pictures, with intervals that say what pictures do not show."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.files.images import read_image
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from surrogate.answers.inverse import Fit, derivative, fitted
from surrogate.answers.inverse_calibration import measure, numbers_calibrated
from surrogate.answers.posterior import invert
from surrogate.answers.sampling import distinct, margins_of, normal_samples, widened
from surrogate.answers.targets import Target, stored_target
from surrogate.cli import main
from surrogate.model import Surrogate
from tests.support.documented import documented_code
from tests.support.two_parameters import TRUE


def _tested(catalog: Catalog) -> str:
    return next(member.name for member in catalog.members if member.split == "test")


@pytest.mark.parametrize("pictures", [1, 2])
def test_a_parameter_comes_back_and_one_without_effect_is_named(two: Path, pictures: int) -> None:
    catalog, surrogate = Catalog.open(two / "catalog.cdb"), Surrogate.load(two / "surrogate")
    targets = [stored_target(catalog, _tested(catalog), view) for view in range(pictures)]
    answer = invert(surrogate, targets, catalog, two)
    p, q = answer.parameters
    assert abs(p.value - TRUE) < 0.03
    assert p.low <= p.value <= p.high
    assert p.identified
    assert not q.identified
    assert "q" in repr(answer)
    assert "not shown" in q.sentence
    assert not answer.foreign
    assert (two / "answers" / f"inverse-{pictures}.json").is_file()
    assert json.loads(json.dumps(answer.to_json()))["parameters"][1]["identified"] is False
    assert invert(surrogate, targets, catalog, two).to_json() == answer.to_json()


def test_the_command_answers_and_flags_another_picture(two: Path) -> None:
    catalog = Catalog.open(two / "catalog.cdb")
    name = _tested(catalog)
    done = CliRunner().invoke(main, ["ask", "which", str(two), f"{name}:0", "--region", "4,4,28,28", "--json"])
    assert done.exit_code == 0, done.output
    assert abs(json.loads(done.output)["parameters"][0]["value"] - TRUE) < 0.05
    own = stored_target(catalog, name, 0)
    answer = invert(Surrogate.load(two / "surrogate"), [Target(1.0 - own.picture, own.camera)], catalog, two)
    assert answer.foreign
    assert answer.sentences[0].startswith("No parameters draw such a picture")


def test_too_few_validation_members_are_refused_with_a_remedy_before_anything_is_fitted() -> None:
    catalog: Any = SimpleNamespace(path=Path("few.cdb"), members=[])
    with pytest.raises(ValueError, match=r"few\.cdb has 0 validation members.*train on 50 or more"):
        measure(Mock(), catalog, 1)
    with pytest.raises(ValueError, match=r"few\.cdb keeps the field of 0 validation members.*train on 50 or more"):
        numbers_calibrated(Mock(learning=Mock(side_effect=AssertionError)), catalog)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["nothing"], "catalog.cdb, such as "),
        (["{name}:999"], "has views 0 to"),
        (["{name}:0", "--region", "1,2,3"], "--region takes X0,Y0,X1,Y1"),
        (["{name}:0", "--region", "9,9,4,4"], "must lie in 32 x 32"),
        (["{file}"], "does not say where its camera stood"),
    ],
)
def test_bad_input_is_refused(two: Path, arguments: list[str], error: str) -> None:
    catalog = Catalog.open(two / "catalog.cdb")
    name = _tested(catalog)
    names = {"name": name, "file": str(two / "run.json")}
    done = CliRunner().invoke(main, ["ask", "which", str(two), *(text.format(**names) for text in arguments)])
    assert done.exit_code == 1
    assert error in done.output


def test_a_blank_picture_is_refused() -> None:
    camera = Camera.look_at((3, 0, 0), (0, 0, 0), vertical_fov_degrees=30, width=4, height=4)
    with pytest.raises(ValueError, match="one colour alone"):
        Target(np.ones((4, 4, 3), np.float32), camera)


def test_levenberg_marquardt_finds_a_minimum_inside_and_at_a_bound() -> None:
    matrix = np.random.default_rng(0).normal(size=(30, 3))
    for truth in ([0.3, -0.5, 0.1], [0.3, -0.5, 1.0]):
        fit = fitted(lambda points, truth=truth: np.sinh(points - truth) @ matrix.T, np.zeros(3))
        assert np.allclose(fit.point, truth, atol=1e-2)
        slopes = derivative(lambda points, truth=truth: np.sinh(points - truth) @ matrix.T, np.array(truth))
        assert np.allclose(slopes, matrix, rtol=1e-2, atol=1e-3)


def test_samples_follow_a_normal_distribution_cut_to_the_box() -> None:
    curvature = np.array([[100.0, 40.0, 0.0], [40.0, 50.0, 0.0], [0.0, 0.0, 1e-9]])
    samples = normal_samples(Fit(np.array([0.1, -0.2, 0.0]), 0.0, curvature), 1.0)
    assert np.allclose(np.cov(samples[:, :2].T), np.linalg.inv(curvature[:2, :2]), rtol=0.3)
    low, high = np.quantile(samples[:, 2], [0.05, 0.95])
    assert low == pytest.approx(-0.9, abs=0.06)
    assert high == pytest.approx(0.9, abs=0.06)


def test_solutions_are_distinct_where_neither_holds_the_other() -> None:
    curvature = 1e4 * np.eye(2)
    fits = [
        Fit(np.array(p), c, curvature)
        for p, c in (([0, 0], 0.0), ([0.001, 0], 0.1), ([0.5, 0], 0.2), ([-0.5, 0], 90.0))
    ]
    assert [fit.cost for fit in distinct(fits, 1.0)] == [0.0, 0.2]


def test_intervals_grow_until_nine_in_ten_truths_lie_inside() -> None:
    random = np.random.default_rng(0)
    truths = np.clip(random.normal(size=(4000, 2)) * [0.1, 0.01], -1.0, 1.0)  # the first as wide again as thought
    ends = np.repeat([[[-0.05, 0.05], [-0.05, 0.05]]], 4000, axis=0)
    margins = margins_of(ends[:2000], truths[:2000])
    assert margins[0] == pytest.approx((1.645 * 0.1 - 0.05) / 0.1, abs=0.06)
    assert margins[1] == 0.0  # never narrower
    grown = widened(ends[2000:], margins)
    inside = (grown[..., 0] <= truths[2000:]) & (truths[2000:] <= grown[..., 1])
    assert inside.mean(0) == pytest.approx([0.9, 1.0], abs=0.02)
    assert np.abs(widened(ends * 15.0, margins)).max() == 1.0  # within the bounds


@pytest.mark.slow
def test_a_figure_shows_pictures_and_intervals_or_intervals_alone(two: Path, tmp_path: Path) -> None:
    name = _tested(Catalog.open(two / "catalog.cdb"))
    sizes = []
    for case in ([f"{name}:0", f"{name}:1", "--region", "4,4,28,28"], [f"{name}:0"], ["--value", "maximum=9"]):
        path = tmp_path / "figure.png"
        made = CliRunner().invoke(main, ["ask", "which", str(two), *case, "-o", str(path)])
        assert made.exit_code == 0, made.output
        assert f"-> {path}" in made.output
        sizes.append(read_image(path).shape)
    assert sizes[0][0] > sizes[1][0]
    assert sizes[1][1] > sizes[2][1]


@pytest.mark.slow
def test_the_documented_code_runs(two: Path) -> None:
    catalog = Catalog.open(two / "catalog.cdb")
    (code,) = [
        block
        for block in documented_code("docs/how-to/questions.md", "Which parameters draw this")
        if "import" in block
    ]
    name, picture = _tested(catalog), stored_target(catalog, _tested(catalog), 3).picture
    names = {"model": Surrogate.load(two / "surrogate"), "catalog": catalog, "folder": two, "picture": picture}
    exec(code.replace('"member-0003", 17', f'"{name}", 3'), names)
    assert "p = " in repr(names["answer"])
