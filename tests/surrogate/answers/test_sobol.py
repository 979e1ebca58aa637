"""Sobol indices, against SALib, against closed forms, and of a surrogate against the simulation itself."""

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
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.answers.sobol import Distribution, Response, field_response, response_of, sobol_indices
from surrogate.cli import main
from surrogate.model import Surrogate
from surrogate.model.representation import WORDS
from tests.support.documented import documented_code
from tests.support.three_parameters import SPACE, shown

BOUNDS = [[-np.pi, np.pi]] * 3
ISHIGAMI = ParameterSpace(
    tuple(Parameter(name, *map(float, bounds)) for name, bounds in zip("abc", BOUNDS, strict=True))
)
FIRST, TOTAL = (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437)  # Saltelli et al. 2000, for 7 and 0.1


def ishigami(points: Any) -> Any:
    a, b, c = np.asarray(points).T
    return (np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a))[:, None]


def salib(function: Any, names: Any, bounds: Any, samples: int) -> Any:
    """SALib's indices, (P,) each."""
    sample = pytest.importorskip("SALib.sample.sobol")
    analyze = pytest.importorskip("SALib.analyze.sobol")
    problem = {"num_vars": len(names), "names": list(names), "bounds": bounds}
    points = sample.sample(problem, samples, calc_second_order=False, scramble=True, seed=5)
    return analyze.analyze(problem, function(points)[:, 0], calc_second_order=False, seed=5)


def test_indices_are_those_of_salib_and_of_the_closed_form() -> None:
    answer = sobol_indices(ISHIGAMI, Response("of Ishigami", ishigami), samples=2048)
    assert np.allclose(answer.first, FIRST, atol=0.03)
    assert np.allclose(answer.total, TOTAL, atol=0.03)
    other = salib(ishigami, ISHIGAMI.names, BOUNDS, 2048)
    assert np.allclose(answer.first, other["S1"], atol=0.03)
    assert np.allclose(answer.total, other["ST"], atol=0.03)
    assert np.allclose(answer.first_half, other["S1_conf"], rtol=0.35)
    assert np.allclose(answer.total_half, other["ST_conf"], rtol=0.35)
    labelled = answer.to_xarray()
    assert np.array_equal(labelled["total"].sel(parameter=["c", "a"]), answer.total[[2, 0]])
    assert labelled.attrs == {"response": "of Ishigami", "distribution": answer.distribution, "samples": 2048}


def test_the_estimators_are_salibs_on_the_same_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """SALib takes the mean over all points, also the mixed ones; hence the tolerance of the first indices."""
    sample = pytest.importorskip("SALib.sample.sobol")
    problem = {"num_vars": 3, "names": list("abc"), "bounds": [[0.0, 1.0]] * 3}
    points = sample.sample(problem, 64, calc_second_order=False, scramble=True, seed=5)
    order = [0, 4, 1, 2, 3]  # SALib: the first, mixed ones, the second
    design = points.reshape(64, 5, 3)[:, order].reshape(-1, 3)
    monkeypatch.setattr("surrogate.answers.sobol._design", lambda *_: design)
    answer = sobol_indices(ISHIGAMI, Response("of Ishigami", ishigami), samples=64)
    other = salib(ishigami, ISHIGAMI.names, BOUNDS, 64)
    assert np.allclose(answer.first, other["S1"], atol=1e-3)
    assert np.allclose(answer.total, other["ST"])


def test_variances_of_several_values_are_summed() -> None:
    """A picture of two pixels, of which the second varies four times as much and by b alone."""

    def two(points: Any) -> Any:
        return np.stack([points[:, 0], 2.0 * points[:, 1]], axis=1)

    answer = sobol_indices(ISHIGAMI, Response("two pixels", two))
    assert np.allclose(answer.first, [0.2, 0.8, 0.0], atol=0.02)
    assert np.allclose(answer.total, [0.2, 0.8, 0.0], atol=0.02)
    assert answer.deviation == pytest.approx(np.sqrt(5.0 * np.pi**2 / 3.0), rel=0.02)


def test_a_response_that_nothing_changes_says_so() -> None:
    answer = sobol_indices(ISHIGAMI, Response("constant", lambda points: np.ones((len(points), 1))), samples=8)
    assert answer.sentences == ["No parameter changes the constant."]
    assert np.isfinite([*answer.first, *answer.total_half]).all()


@pytest.mark.slow
def test_the_surrogate_agrees_with_salib_on_the_simulation(surrogate_of_three: Surrogate) -> None:
    """320 runs of the simulation itself, in SALib's hands, against the emulated field."""
    high = 0.5

    def simulated(shares: Any) -> Any:
        rows = SPACE.denormalize(2.0 * shares - 1.0)
        return np.array([[np.mean(shown(*row) > high)] for row in rows])

    truth = salib(simulated, SPACE.names, [[0.0, 1.0]] * 3, 64)
    answer = sobol_indices(SPACE, field_response(surrogate_of_three, "share_above", high), samples=256)
    assert np.abs(answer.first - truth["S1"]).max() < 0.1
    assert np.abs(answer.total - truth["ST"]).max() < 0.1


@pytest.mark.parametrize("of", ["picture", "colour", "opacity", "mean", "minimum", "maximum"])
@pytest.mark.parametrize("drawn_by", ["gaussians", "field", "both"])
def test_every_quantity_has_indices(
    surrogate_of_three: Surrogate, catalog_of_three: Catalog, of: str, drawn_by: str
) -> None:
    camera = catalog_of_three.plan.cameras[3]
    answer = sobol_indices(SPACE, response_of(surrogate_of_three.using(drawn_by), camera, of), samples=16)
    assert answer.total.argmax() == 0 or drawn_by == "gaussians"
    by_gaussians = drawn_by == "gaussians" and of in ("picture", "colour", "opacity")
    assert answer.response.source == WORDS["gaussians" if by_gaussians else "field"]


def test_gaussians_alone_have_no_numbers(surrogate_of_three: Surrogate, catalog_of_three: Catalog) -> None:
    surrogate = replace(surrogate_of_three, field=None)
    answer = sobol_indices(SPACE, response_of(surrogate, catalog_of_three.plan.cameras[3]), samples=8)
    assert answer.response.source == WORDS["gaussians"]
    assert answer.response.lengths is None
    with pytest.raises(ValueError, match="has no emulated field, so no numbers"):
        response_of(surrogate, catalog_of_three.plan.cameras[3], "mean")


def test_a_region_is_drawn_alone(surrogate_of_three: Surrogate, catalog_of_three: Catalog) -> None:
    camera, region = catalog_of_three.plan.cameras[3], (8, 4, 20, 28)
    surrogate, row = surrogate_of_three.using("gaussians"), [[0.3, 10.0, 0.5]]
    part = response_of(surrogate, camera, "opacity", region=region).values(np.array(row))
    whole = surrogate.render(row, camera)[0, 4:28, 8:20, 3]
    assert part[0, 0] == pytest.approx(whole.mean(), abs=1e-3)


def test_parameters_are_distributed_as_named(catalog_of_three: Catalog) -> None:
    even, members = Distribution.even(SPACE), Distribution.of_members(SPACE, catalog_of_three)
    assert even.words == "even within the bounds, q on a logarithmic scale"
    assert members.words == "each independently, as the 26 members are distributed"
    shares = np.array([[0.0, 0.5, 1.0]])
    assert np.allclose(even.quantiles(shares), [[-1.0, 0.0, 1.0]])
    values = SPACE.normalize([SPACE.values(member.parameters) for member in catalog_of_three.members])
    drawn = members.quantiles(np.full((1, 3), 0.5))
    assert np.allclose(drawn, np.median(values, axis=0), atol=0.05)
    assert np.allclose(members.quantiles(np.zeros((1, 3))), values.min(0))


def test_the_command_says_draws_and_writes_json(three: Path, tmp_path: Path) -> None:
    figure = tmp_path / "indices.png"
    arguments = ["ask", "matters", str(three), "-n", "16", "--as-members", "--view", "3"]
    done = CliRunner().invoke(main, [*arguments, "--of", "mean", "-o", str(figure)])
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[0] == "Shares of the variance of the mean of the field, by the emulated field."
    assert "as the 26 members are distributed; 80 points" in lines[1]
    assert lines[2].startswith("p ")
    assert "length scale" in lines[2]
    with Image.open(figure) as picture:
        assert picture.width > picture.height > 200
    done = CliRunner().invoke(main, [*arguments, "--region", "8,8,24,24", "--json"])
    answer = json.loads(done.output)
    assert answer["response"] == "pixels in the region 8, 8 to 24, 24"
    assert answer["indices"]["p"]["total"] > answer["indices"]["r"]["total"]
    assert answer["indices"]["p"]["length"] > 0.0


def test_the_documented_code_runs(
    surrogate_of_three: Surrogate, catalog_of_three: Catalog, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("surrogate.answers.sobol.sobol_indices.__kwdefaults__", {"samples": 8, "seed": 0})
    member = catalog_of_three.members[0]
    (code,) = [block for block in documented_code("docs/how-to/questions.md", "What matters") if "import" in block]
    names: dict[str, Any] = {
        "surrogate": surrogate_of_three.using("field"),
        "catalog": catalog_of_three,
        "parameters": member.parameters,
        "camera": member.cameras[0].resized(128, 128),
    }
    exec(code, names)
    assert names["here"].maps.shape == (3, 128, 128, 3)
    assert names["everywhere"].total.shape == (3,)
    assert repr(names["here"]).startswith("<Sensitivity: p ")
    assert repr(names["everywhere"]).startswith("<SobolIndices of the pixels of the picture: p ")
