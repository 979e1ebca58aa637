"""A page that draws by itself holds to the engine, opens from a file without a request, and runs nothing but ours."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import torch

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate import Surrogate
from surrogate.appearance.averages import resampled
from surrogate.appearance.scale import ValueScale
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.request import setting_of
from surrogate.explore.run import Run
from tests.support.browsers import serious_findings
from tests.support.drawn_models import BASE, CENTER, EXTENT, SIDE, cameras, carrying, colored
from tests.support.drawn_pages import assert_agree, decibels, drawn, opened, places_of

if TYPE_CHECKING:
    from playwright.sync_api import Page

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


MODELS: dict[str, Callable[[], Surrogate]] = {
    "colours": colored,
    "colours of degree 1": lambda: colored(12),
    "four samples a pixel": lambda: colored(3, 2),
    "values": carrying,
    "values with one opacity from everywhere": lambda: carrying(medium=False, frequencies=2),
    "values that follow a field, logarithmic": lambda: carrying(follow=True, scale="log"),
}


@pytest.mark.parametrize("name", MODELS)
def test_the_page_draws_what_the_engine_draws(page: Page, tmp_path: Path, name: str) -> None:
    surrogate = MODELS[name]()
    opened(page, surrogate, tmp_path)
    cases, expected = [], []
    for camera, parameters in zip(cameras(5), places_of(surrogate), strict=False):
        cases.append({"parameters": parameters, "camera": camera.to_json()})
        expected.append(surrogate.at(parameters).render(camera, background=WHITE))
    assert_agree(page, cases, expected)


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


@pytest.mark.slow
def test_half_floats_lose_little(page: Page, tmp_path: Path) -> None:
    surrogate = carrying()
    opened(page, surrogate, tmp_path)
    without = "name => name === 'EXT_float_blend' ? null : own.call(this, name)"
    page.evaluate(
        "() => { const { prototype } = WebGL2RenderingContext, own = prototype.getExtension;"
        f"prototype.getExtension = function (name) {{ return ({without})(name); }}; }}"
    )
    cases = [{"parameters": surrogate.space.middle, "camera": camera.to_json()} for camera in cameras(3)]
    for found, camera in zip(drawn(page, cases, "card"), cameras(3), strict=True):
        expected = surrogate.at(surrogate.space.middle).render(camera, background=WHITE)
        assert decibels(found, expected) >= 65.0


LOOKS: dict[str, list[dict[str, Any]]] = {
    "four samples a pixel": [{}],
    "values that follow a field, logarithmic": [{}],
    "values": [
        {"color_map": "viridis"},
        {"function": {"opacity_points": [[0.1, 0.0], [0.5, 0.9], [0.6, 0.1]]}, "color_map": "turbo"},
        {"function": {"opacity_points": [[0, 0.9], [1, 0]], "color_points": [[0, 1, 0, 0], [1, 0, 1, 1]]}},
    ],
}


@pytest.mark.parametrize("name", LOOKS)
def test_what_is_shown_is_the_picture_in_8_bits(page: Page, tmp_path: Path, name: str) -> None:
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
    camera = Camera.look_at(place, CENTER, vertical_fov_degrees=40.0, width=SIDE, height=SIDE - 8)
    background, parameters = (0x33 / 255, 0x66 / 255, 0x99 / 255), surrogate.space.middle
    size = {"size": [SIDE, SIDE - 8], "background": "#336699", "form": "png"}
    for look in LOOKS[name]:
        asked = setting_of({"parameters": parameters, **look}, surrogate)
        expected = 255.0 * asked.member(surrogate).render(camera, background=background)[..., :3]
        assert np.ptp(expected) > 50.0
        for engine in ("card", "scripts"):
            plain = {"parameters": parameters, "visualization": {}, "color_map": "", "using": f"gaussians-{engine}"}
            found = page.evaluate(script, {"settings": [plain | look], "camera": seen, **size})
            found = np.reshape(found, (SIDE - 8, SIDE, 4))[..., :3]
            assert np.abs(found - expected).max() < 1.01, (look, engine)


def test_nodes_are_those_of_python(page: Page, tmp_path: Path) -> None:
    opened(page, carrying(), tmp_path)
    knots = ValueScale.of_function(BASE).knots
    script = """async ([transfer, unit, knots]) => {
      const { places, columns } = (await import("draw/nodes.js")).resampled(transfer, unit, knots);
      return [[...places], [...columns]];
    }"""
    for name, function in FUNCTIONS.items():
        expected = resampled(function, BASE.opacity_unit_distance, knots)
        transfer = json.loads(json.dumps(vars(function)))
        places, columns = page.evaluate(script, [transfer, BASE.opacity_unit_distance, knots.tolist()])
        np.testing.assert_allclose(places, expected.places, atol=1e-12, err_msg=name)
        columns = np.reshape(columns, (-1, 4))
        np.testing.assert_allclose(columns, expected.columns, rtol=1e-9, atol=1e-12, err_msg=name)


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


@pytest.mark.slow
def test_scripts_draw_while_the_card_is_lost(page: Page, tmp_path: Path) -> None:
    opened(page, colored(), tmp_path)
    script = """async request => {
      const { frame, ways } = await import("draw/local.js"), found = [], { canvas, gl } = ways.graphics;
      const draw = async () => { found.push((await frame(request)).by[0]); };
      const lose = gl.getExtension("WEBGL_lose_context");
      const event = name => new Promise(resolve => canvas.addEventListener(name, () => setTimeout(resolve)));
      await draw();
      const lost = event("webglcontextlost"), restored = event("webglcontextrestored");
      lose.loseContext();
      await lost;
      await draw();
      lose.restoreContext();
      await restored;
      await draw();
      return found;
    }"""
    seen = {"position": [1e3, -2.1e3, 5.0], "target": CENTER.tolist(), "up": [0.0, 0.0, 1.0], "field": 40.0}
    setting = {"parameters": colored().space.middle, "visualization": {}, "color_map": "", "using": "gaussians-card"}
    request = {"settings": [setting], "camera": seen, "size": [SIDE, SIDE], "background": "#000000", "form": "png"}
    assert page.evaluate(script, request) == ["graphics card", "scripts", "graphics card"]


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
    empty = replace(made, gaussians=made.gaussians.of(torch.zeros(0, dtype=torch.int64)))
    with pytest.raises(ValueError, match="hold neither: explore the run"):
        page_bytes(Run("a run", empty))


def test_a_page_is_small_beside_its_model() -> None:
    surrogate = colored()
    assert len(page_bytes(Run("a run", surrogate))) < 1.4e6 * surrogate.megabytes + 150_000
    assert html.escape("a & b") in page_bytes(Run("a & b", surrogate)).decode()
