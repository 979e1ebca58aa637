"""Maps of local sensitivity, against differences of the pictures of the simulation itself."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from native.ray_casting import draw_volume
from surrogate.answers.sensitivity import Sensitivity, Steps, correlations, sensitivity
from surrogate.cli import main
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.model import Surrogate
from tests.support.hooked import FUNCTION
from tests.support.three_parameters import SPACE, SPACING, shown

HERE = {"p": 0.4, "q": 20.0, "r": 0.5}


@pytest.fixture
def surrogate(surrogate_of_three: Surrogate) -> Surrogate:
    return surrogate_of_three


@pytest.fixture
def camera(catalog_of_three: Catalog) -> Camera:
    return catalog_of_three.plan.cameras[3]


def simulated(parameters: dict[str, float], camera: Camera) -> Any:
    picture = draw_volume(shown(**parameters), None, SPACING, (0.0, 0.0, 0.0), VolumeRendering("dvr", FUNCTION), camera)
    return composite(picture, WHITE)


def differences(camera: Camera, step: float = 0.01) -> Any:
    """The simulation's own maps (P, H, W, 3)."""
    steps = Steps.about(SPACE, HERE, step)
    pictures = np.stack([simulated(dict(row), camera) for row in steps.rows])
    return (pictures[:3] - pictures[3:]) / steps.widths[:, None, None, None]


@pytest.mark.slow
def test_maps_are_those_of_the_simulation(surrogate: Surrogate, camera: Camera) -> None:
    answer = sensitivity(surrogate.using("field"), HERE, camera, region=(8, 8, 24, 24))
    truth = differences(camera)
    for j in (0, 1):
        error = np.linalg.norm(answer.maps[j] - truth[j]) / np.linalg.norm(truth[j])
        assert error < 0.15
    assert answer.of_view[2] < 0.02 * answer.of_view[0]
    assert (np.argsort(-answer.of_view) == [0, 1, 2]).all()
    assert answer.of_region is not None
    assert np.allclose(answer.of_region, answer.magnitudes[:, 8:24, 8:24].mean((1, 2)))
    assert np.allclose(answer.picture, simulated(HERE, camera), atol=0.05)


@pytest.mark.parametrize("drawn_by", ["gaussians", "field", "both"])
def test_two_predictions_are_compared(surrogate: Surrogate, camera: Camera, drawn_by: str) -> None:
    answer = sensitivity(surrogate.using(drawn_by), HERE, camera)
    assert answer.maps.shape == (3, 32, 32, 3)
    assert answer.agreements is not None
    assert answer.agreements.shape == (3,)
    assert sensitivity(surrogate.using(drawn_by), HERE, camera, compare=False).agreements is None


def test_gaussians_alone_say_that_nothing_tells_how_certain_maps_are(surrogate: Surrogate, camera: Camera) -> None:
    answer = sensitivity(replace(surrogate, field=None), HERE, camera)
    assert answer.agreements is None
    assert answer.sentences[-1].startswith("Drawn by the Gaussians alone")
    assert answer.to_json()["changes"]["p"]["agreement"] is None


def test_the_mean_image_has_the_mean_of_both_maps(surrogate: Surrogate, camera: Camera) -> None:
    first, second, both = (
        sensitivity(surrogate.using(name), HERE, camera, compare=False).maps for name in ("gaussians", "field", "both")
    )
    assert np.allclose(both, 0.5 * (first + second), atol=1e-6)


def test_steps_end_at_the_bounds() -> None:
    steps = Steps.about(SPACE, {"p": 0.0, "q": 100.0, "r": 0.5}, 0.01)
    assert np.allclose(steps.widths, [0.01, 0.01, 0.02])
    assert all(SPACE.outside([row[name] for name in SPACE.names]) == {} for row in steps.rows)
    assert steps.rows[0] == {"p": pytest.approx(0.01), "q": pytest.approx(100.0), "r": 0.5}
    assert steps.rows[4] == {"p": 0.0, "q": pytest.approx(100.0**0.99), "r": 0.5}


def test_maps_that_hardly_change_agree_about_nothing() -> None:
    random = np.random.default_rng(0)
    one = random.normal(size=(4, 5, 5, 3)).astype(np.float32)
    other = one.copy()
    other[1], one[2], other[2], other[3] = -one[1], 1e-4, 1e-5, 0.0
    assert np.allclose(correlations(one, other), [1.0, -1.0, np.nan, 0.0], equal_nan=True)
    space = ParameterSpace(tuple(Parameter(name, 0.0, 1.0) for name in "abcd"))
    answer = Sensitivity(space, {}, one[0], one, None, correlations(one, other), "Gaussians")
    ends = [answer.doubt(j) for j in range(4)]
    assert ends[0] == "; two predictions agree 1.00"
    assert ends[1].endswith("the map is uncertain")
    assert ends[2] == ""
    assert json.loads(json.dumps(answer.to_json()))["changes"]["c"]["agreement"] is None
    labelled = answer.to_xarray()
    assert np.array_equal(labelled["maps"].sel(parameter="c", channel="blue"), one[2, ..., 2])
    assert float(labelled["agreement"].sel(parameter="b")) == pytest.approx(-1.0)


def test_the_command_says_draws_and_writes_json(three: Path, tmp_path: Path) -> None:
    here = [argument for name, value in HERE.items() for argument in ("-p", f"{name}={value}")]
    figure = tmp_path / "matters.png"
    arguments = ["ask", "matters", str(three), *here, "--view", "3", "--region", "8,8,24,24"]
    done = CliRunner().invoke(main, [*arguments, "-o", str(figure)])
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[0].startswith("Mean change of the colours")
    assert lines[1].split()[0] == "p"
    with Image.open(figure) as picture:
        assert picture.width > picture.height > 300
    done = CliRunner().invoke(main, [*arguments, "--json"])
    assert json.loads(done.output)["changes"]["p"]["region"] > 0.0


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["-p", "p=0.5"], "missing q, r"),
        (["-p", "p=2", "-p", "q=10", "-p", "r=0"], "p = 2 lies outside its bounds"),
        (["-p", "p=0.5", "-p", "q=10", "-p", "r=0", "--region", "0,0,99,9"], "must lie in 32 x 32"),
        (["-p", "p=0.5", "-p", "q=10", "-p", "r=0", "--of", "mean"], "leave out -p"),
        (["-p", "p=0.5", "-p", "q=10", "-p", "r=0", "--view", "99"], "--view must be below 12"),
        (["-n", "100"], "a power of two"),
        (["--of", "share_above"], "takes a level"),
        (["--of", "mean", "--region", "0,0,9,9"], "a region is of pictures"),
        (["--above", "1"], "a level of share_above"),
    ],
)
def test_bad_input_is_refused(three: Path, arguments: list[str], error: str) -> None:
    done = CliRunner().invoke(main, ["ask", "matters", str(three), *arguments])
    assert done.exit_code == 1
    assert error in done.output


def test_steps_are_checked(surrogate: Surrogate, camera: Camera) -> None:
    with pytest.raises(ValueError, match="step must be above 0"):
        sensitivity(surrogate, HERE, camera, step=0.0)
