"""A page that draws by itself holds to the engine, opens from a file without a request, and runs nothing but ours."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate import Surrogate
from surrogate.appearance.averages import resampled
from surrogate.appearance.field_gaussians import FieldGaussians, FieldValues
from surrogate.appearance.scale import ValueScale
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.emulated_values import EmulatedValues
from surrogate.emulation.processes import Processes
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run
from surrogate.gaussians import Normalization
from surrogate.lighting import Lighting
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.storage.encoding import encode
from tests.support.browsers import serious_findings
from tests.support.drawn_pages import decibels, drawn, opened
from tests.support.surrogates import some_surrogate

if TYPE_CHECKING:
    from playwright.sync_api import Page

SIDE, COUNT = 64, 400
CENTER, EXTENT = np.array([1e3, -2e3, 5.0]), 40.0
BASE = TransferFunction(
    ((0.0, 0.1, 0.2, 0.8), (0.4, 0.9, 0.9, 0.4), (1.0, 0.8, 0.1, 0.1)),
    ((0.0, 0.0), (0.3, 0.2), (0.7, 0.05), (1.0, 0.9)),
    0.3,
)
FUNCTIONS = {
    "two points": TransferFunction(((0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0)), ((0.0, 0.4), (1.0, 0.4)), 0.3),
    "opaque": TransferFunction(BASE.color_points, ((0.0, 0.0), (0.5, 1.0), (1.0, 1.0)), 0.1),
    "steps": TransferFunction(
        BASE.color_points, ((0.0, 0.0), (0.4, 0.0), (0.4001, 0.8), (0.6, 0.8), (0.6001, 0.0), (1.0, 0.0)), 0.5
    ),
    "twelve points": TransferFunction(
        BASE.color_points, tuple((k / 11.0, 0.5 + 0.4 * math.sin(7.0 * k)) for k in range(12)), 0.2
    ),
    "nothing": TransferFunction(BASE.color_points, ((0.0, 0.0), (1.0, 0.0)), 0.3),
}


def colored(columns: int = 3, samples: int = 1) -> Surrogate:
    made = replace(some_surrogate(columns, COUNT), rasterizer=Rasterizer(samples=samples))
    fainter = replace(
        made.gaussians, opacity_logits=made.gaussians.opacity_logits - 2.5
    )  # few pixels reach what is cut off
    return replace(made, gaussians=fainter, normalization=Normalization(CENTER, EXTENT))


def carrying(medium: bool = True, frequencies: int = 0, follow: bool = False, scale: str = "linear") -> Surrogate:
    """Gaussians that carry values, in few bits as they are stored."""
    random = torch.Generator().manual_seed(5)
    shapes = {"means": 3, "log_scales": 3, "quats": 4, "values": 2}
    table = {name: torch.randn(COUNT, width, generator=random) for name, width in shapes.items()}
    table["means"] *= 0.4
    table["log_scales"] = 0.4 * table["log_scales"] - 2.2
    table["values"] = torch.stack([0.5 + 0.3 * table["values"][:, 0], -3.0 + table["values"][:, 1]], dim=1)
    scaled = ValueScale.of_function(BASE)
    gaussians = FieldGaussians.of_tensors(
        table | {"opacity_logits": 2.0 * torch.randn(COUNT, generator=random)}, FieldValues(BASE, scaled, medium)
    )
    settings = TrainingSettings(latent_size=5, hidden_width=8, parameter_frequencies=frequencies)
    blank = BilinearDeformation.create(gaussians, 2, settings)
    moving = blank.with_tensors(
        {
            n: t + (0.2 if n == "weights_out" else 0.05) * torch.randn(t.shape, generator=random)
            for n, t in blank.tensors().items()
        }
    )
    if follow:
        points = np.random.default_rng(1).uniform(-1.0, 1.0, (9, 2))
        processes = Processes.fit(points, np.column_stack([np.sin(3.0 * points[:, 0]), points[:, 1] ** 2 - 0.3]))
        modes = 0.3 * torch.randn(COUNT, 2, generator=random)
        moving = replace(moving, emulated=EmulatedValues(0.5 + 0.2 * table["means"][:, 0], modes, processes, scaled))
    space = ParameterSpace((Parameter("Re", 100.0, 2500.0, scale=scale), Parameter("time", 0.0, 2.0, "s")))
    made = Surrogate(gaussians, moving, space, Normalization(CENTER, EXTENT), Rasterizer(), (1.0, 1.0, 1.0))
    encodings = {f"gaussians.{name}": encode(getattr(gaussians, name), "uint8") for name in ("quats", "opacity_logits")}
    encodings["deformation.latents"] = encode(moving.latents, "uint8")
    encodings["gaussians.means"] = encode(gaussians.means, "uint16")
    encodings["gaussians.log_scales"] = encode(gaussians.log_scales, "float16")
    decoded = {name.removeprefix("gaussians."): e.decoded() for name, e in encodings.items() if "gaussians" in name}
    order = ("means", "log_scales", "quats", "opacity_logits", "values")
    stored = gaussians.with_tensors([decoded.get(name, getattr(gaussians, name)) for name in order])
    latents = moving.with_tensors({**moving.tensors(), "latents": encodings["deformation.latents"].decoded()})
    return replace(made, gaussians=stored, deformation=latents, encodings=encodings)


MODELS: dict[str, Callable[[], Surrogate]] = {
    "colours": colored,
    "colours of degree 1": lambda: colored(12),
    "four samples a pixel": lambda: colored(3, 2),
    "values": carrying,
    "values with one opacity from everywhere": lambda: carrying(medium=False, frequencies=2),
    "values that follow a field, logarithmic": lambda: carrying(follow=True, scale="log"),
}


def cameras(count: int) -> list[Camera]:
    """From around the volume, and the last from inside it."""
    random = np.random.default_rng(2)
    made = []
    for number in range(count):
        direction = random.standard_normal(3)
        distance = (0.3 if number == count - 1 else 3.0) * EXTENT
        place = CENTER + distance * direction / np.linalg.norm(direction)
        target = CENTER + 0.1 * EXTENT * random.standard_normal(3)
        made.append(Camera.look_at(place, target, vertical_fov_degrees=40.0, width=SIDE, height=SIDE - 8))
    return made


@pytest.mark.parametrize("name", MODELS)
def test_the_page_draws_what_the_engine_draws(page: Page, tmp_path: Path, name: str) -> None:
    surrogate = MODELS[name]()
    opened(page, surrogate, tmp_path)
    random, cases, expected = np.random.default_rng(0), [], []
    for camera in cameras(5):
        row = surrogate.space.denormalize(random.uniform(-1.0, 1.0, 2)).tolist()
        parameters = dict(zip(surrogate.space.names, row, strict=True))
        cases.append({"parameters": parameters, "camera": camera.to_json()})
        expected.append(surrogate.at(parameters).render(camera, background=WHITE))
    assert max(float(picture.mean()) for picture in expected) < 0.99
    for engine, mean, worst in (("card", 95.0, 85.0), ("scripts", 80.0, 75.0)):
        found = drawn(page, cases, engine)
        scores = [decibels(*pair) for pair in zip(found, expected, strict=True)]
        assert np.mean(scores) >= mean, (engine, scores)
        assert min(scores) >= worst, (engine, scores)


def test_any_transfer_function_is_drawn(page: Page, tmp_path: Path) -> None:
    surrogate, camera = carrying(follow=True), cameras(1)[0]
    opened(page, surrogate, tmp_path)
    parameters = surrogate.space.middle
    shared = {"parameters": parameters, "camera": camera.to_json()}
    cases = [{**shared, "transfer": json.loads(json.dumps(vars(function)))} for function in FUNCTIONS.values()]
    for engine, worst in (
        ("card", 80.0),
        ("scripts", 75.0),
    ):  # of what is opaque a card draws on, where the engine stops
        for name, picture in zip(FUNCTIONS, drawn(page, cases, engine), strict=True):
            expected = surrogate.under(FUNCTIONS[name], parameters).render(camera, background=WHITE)
            assert decibels(picture, expected) >= worst, (engine, name)


@pytest.mark.parametrize("engine", ["card", "scripts"])
@pytest.mark.parametrize("name", ["four samples a pixel", "values that follow a field, logarithmic"])
def test_what_is_shown_is_the_picture_in_8_bits(page: Page, tmp_path: Path, name: str, engine: str) -> None:
    surrogate = MODELS[name]()
    opened(page, surrogate, tmp_path)
    script = """async request => {
      const { frame } = await import("draw/local.js"), { pictures: [bitmap] } = await frame(request);
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = request.size;
      const context = canvas.getContext("2d");
      context.drawImage(bitmap, 0, 0);
      return [...context.getImageData(0, 0, ...request.size).data];
    }"""
    place = (CENTER + EXTENT * np.array([0.0, -2.5, 0.5])).tolist()
    seen = {"position": place, "target": CENTER.tolist(), "up": [0.0, 0.0, 1.0], "field": 40.0}
    setting = {"parameters": surrogate.space.middle, "visualization": {}, "color_map": "", "using": engine}
    request = {"settings": [setting], "camera": seen, "size": [SIDE, SIDE - 8], "background": "#336699", "form": "png"}
    found = np.reshape(page.evaluate(script, request), (SIDE - 8, SIDE, 4))[..., :3]
    camera = Camera.look_at(place, CENTER, vertical_fov_degrees=40.0, width=SIDE, height=SIDE - 8)
    background = (0x33 / 255, 0x66 / 255, 0x99 / 255)
    expected = 255.0 * surrogate.at(surrogate.space.middle).render(camera, background=background)[..., :3]
    assert np.ptp(expected) > 50.0
    assert np.abs(found - expected).max() < 1.01


@pytest.mark.parametrize("name", FUNCTIONS)
def test_nodes_are_those_of_python(page: Page, tmp_path: Path, name: str) -> None:
    opened(page, carrying(), tmp_path)
    knots = ValueScale.of_function(BASE).knots
    expected = resampled(FUNCTIONS[name], BASE.opacity_unit_distance, knots)
    script = """async ([transfer, unit, knots]) => {
      const { places, columns } = (await import("draw/nodes.js")).resampled(transfer, unit, knots);
      return [[...places], [...columns]];
    }"""
    transfer = json.loads(json.dumps(vars(FUNCTIONS[name])))
    places, columns = page.evaluate(script, [transfer, BASE.opacity_unit_distance, knots.tolist()])
    np.testing.assert_allclose(places, expected.places, atol=1e-12)
    np.testing.assert_allclose(np.reshape(columns, (-1, 4)), expected.columns, rtol=1e-9, atol=1e-12)


def test_a_file_opens_without_a_request_and_all_controls_work(page: Page, tmp_path: Path) -> None:
    requests = opened(page, carrying(), tmp_path)
    before = page.evaluate("document.querySelector('#stage canvas').toDataURL()")
    page.locator("#parameter-0").focus()
    page.keyboard.press("End")
    page.wait_for_function("() => window.explorer.resting")
    assert page.evaluate("document.querySelector('#stage canvas').toDataURL()") != before
    for mode in ("compare", "sweep", "view"):
        page.locator(f"#mode-{mode}").click()
        page.wait_for_function("() => window.explorer.resting")
        assert page.locator("#export-kind option").all_inner_texts() == ["PNG"]
    with page.expect_download() as saved:
        page.locator("#export").click()
    assert saved.value.suggested_filename == "a run.png"
    assert serious_findings(page) == []
    assert requests == [(tmp_path / "page.html").as_uri()]


def test_names_are_words_and_never_markup(page: Page, tmp_path: Path) -> None:
    bad = "</script><script>window.broken = 1</script><img src=x onerror='window.broken=1'>"
    surrogate = carrying()
    space = ParameterSpace((Parameter("Re", 1.0, 2.0, bad), surrogate.space.parameters[1]))
    opened(page, replace(surrogate, space=space), tmp_path, bad)
    assert page.evaluate("window.broken") is None
    assert bad in page.locator("h1").inner_text()
    assert page.title().startswith(bad)


def test_what_others_put_into_a_page_does_not_run(page: Page, tmp_path: Path, complaints: list[str]) -> None:
    content = page_bytes(Run("a run", carrying())).decode()
    (tmp_path / "page.html").write_text(content.replace("<body>", "<body><script>window.broken = 1</script>"))
    page.goto((tmp_path / "page.html").as_uri())
    page.wait_for_function("() => document.documentElement.dataset.shown")
    assert page.evaluate("window.broken") is None
    assert "Content Security Policy" in complaints.pop()


def test_what_a_page_cannot_draw_is_refused() -> None:
    made = colored()
    lit = replace(made.gaussians, lighting=Lighting((0.5, 0.5, 0.5), 0.3, 0.6, 0.1, 20.0))
    with pytest.raises(ValueError, match="lit surfaces: explore the run with `surrogate explore RUN`"):
        page_bytes(Run("a run", replace(made, gaussians=lit)))
    empty = replace(made, gaussians=made.gaussians.of(torch.zeros(0, dtype=torch.int64)))
    with pytest.raises(ValueError, match="this surrogate has none: explore the run"):
        page_bytes(Run("a run", empty))


def test_a_page_is_small_beside_its_model() -> None:
    surrogate = colored()
    assert len(page_bytes(Run("a run", surrogate))) < 1.4e6 * surrogate.megabytes + 220_000
    assert html.escape("a & b") in page_bytes(Run("a & b", surrogate)).decode()
