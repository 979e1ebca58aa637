"""A page draws the emulated field as the ray caster does: volumes and surfaces, with holes, by a card and by scripts."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from surrogate.evaluation.metrics import WHITE
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run
from surrogate.model.representation import RepresentationScores
from tests.support.drawn_pages import decibels, field_drawn, opened, places_of
from tests.support.emulated_models import MODELS, PEAK, SPACE, both, cameras, model, surfaces

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", MODELS)
def test_the_page_draws_what_the_ray_caster_draws(page: Page, tmp_path: Path, name: str) -> None:
    make, settings = MODELS[name]
    surrogate = make()
    opened(page, surrogate, tmp_path)
    cases, expected = [], []
    for camera, parameters, visualization in zip(
        cameras(), places_of(surrogate), itertools.cycle(settings), strict=False
    ):
        cases.append({"parameters": parameters, "visualization": visualization, "camera": camera.to_json()})
        expected.append(surrogate.at(parameters | visualization).render(camera, background=WHITE))
    assert max(float(picture.mean()) for picture in expected) < 0.99
    for engine in ("card", "scripts"):
        found = field_drawn(page, cases, engine)
        scores = [decibels(*pair) for pair in zip(found, expected, strict=True)]
        assert min(scores) >= 110.0, (engine, scores)


def test_a_surface_larger_than_a_tile_is_whole(page: Page, tmp_path: Path) -> None:
    surrogate, camera = surfaces(), cameras()[0].resized(300, 30)
    opened(page, surrogate, tmp_path)
    case = {"parameters": SPACE.middle, "visualization": {"isovalue": 0.2}, "camera": camera.to_json()}
    expected = surrogate.at(SPACE.middle, isovalue=0.2).render(camera, background=WHITE)
    (found,) = field_drawn(page, [case], "card")
    assert decibels(found, expected) >= 110.0


def test_any_function_is_drawn_by_the_distance_that_fits_it(page: Page, tmp_path: Path) -> None:
    surrogate, camera, parameters = model(), cameras()[0], SPACE.middle
    opened(page, surrogate, tmp_path)
    transfer = {"function": vars(PEAK), "free": True}
    case = {"parameters": parameters, "visualization": {}, "camera": camera.to_json(), "transfer": transfer}
    expected = surrogate.under(PEAK, parameters).render(camera, background=WHITE)
    for engine in ("card", "scripts"):
        (found,) = field_drawn(page, [case], engine)
        assert decibels(found, expected) >= 110.0, engine


def test_the_page_offers_all_ways_to_draw_and_takes_the_best(page: Page, tmp_path: Path) -> None:
    surrogate = both()
    opened(page, surrogate, tmp_path)
    names = page.locator("#using option").evaluate_all("options => options.map(option => option.value)")
    ways = [f"{kind}-{device}" for kind in ("gaussians", "field", "both") for device in ("card", "scripts")]
    assert names == ["", *ways]
    script = """async ([request, ways]) => {
      const { frame } = await import("draw/local.js"), found = [];
      for (const using of ways) {
        const { pictures: [bitmap], by } = await frame({ ...request, settings: [{ ...request.settings[0], using }] });
        const canvas = document.createElement("canvas");
        [canvas.width, canvas.height] = request.size;
        const context = canvas.getContext("2d");
        context.drawImage(bitmap, 0, 0);
        found.push([[...context.getImageData(0, 0, ...request.size).data], by[0]]);
      }
      return found;
    }"""
    camera = cameras()[0]
    seen = {"position": camera.position.tolist(), "target": (camera.position + camera.forward).tolist()}
    seen |= {"up": camera.up.tolist(), "field": camera.vertical_fov_degrees}
    setting = {"parameters": surrogate.space.middle, "visualization": {}, "color_map": ""}
    request = {"settings": [setting], "camera": seen, "size": [64, 56], "background": "#ffffff", "form": "png"}
    for name, (data, by) in zip(["", *ways], page.evaluate(script, [request, ["", *ways]]), strict=True):
        using = name.partition("-")[0] or "field"
        expected = surrogate.using(using).at(surrogate.space.middle).render(camera, background=WHITE)
        found = np.reshape(data, (56, 64, 4))[..., :3]
        assert np.abs(found - 255.0 * expected[..., :3]).mean() < 0.6, name
        assert {"gaussians": "Gaussians", "field": "emulated field", "both": "mean image"}[using] in by


def test_functions_that_the_gaussians_do_not_follow_are_drawn_from_the_field(page: Page, tmp_path: Path) -> None:
    surrogate = replace(both(), scores=RepresentationScores())
    opened(page, surrogate, tmp_path, modes=9)
    script = """async function_ => {
      const { ways } = await import("draw/local.js"), plain = { visualization: {}, color_map: "" };
      return [plain, { ...plain, function: function_ }].map(setting => ways.of(setting)[0]);
    }"""
    assert page.evaluate(script, vars(PEAK)) == ["gaussians", "field"]


def test_the_field_is_there_where_it_draws_best_or_modes_are_asked_for() -> None:
    surrogate = both()
    sizes = {modes: len(page_bytes(Run("a run", surrogate), None, modes)) for modes in (None, 0, 1, 99)}
    assert sizes[0] < sizes[1] < sizes[99] == sizes[None]
    worse = replace(surrogate, scores=RepresentationScores())
    assert len(page_bytes(Run("a run", worse))) == pytest.approx(sizes[0], abs=99)
    with pytest.raises(ValueError, match="hold neither: explore the run"):
        page_bytes(Run("a run", model()), None, 0)
