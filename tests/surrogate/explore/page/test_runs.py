"""The map of runs shows what to expect over the parameters, and goes where it is pressed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from surrogate import Surrogate
from tests.support.explored import assert_shown, open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

WHOLE = "() => document.querySelector('.runs .expectation, .runs rect')"
NUMBERS = """async places => {
  const { Doubt } = await import("draw/doubt.js"), { normalized } = await import("draw/parameters.js");
  const { survey } = await import(new URL("explore/connection.js", document.baseURI)), { facts } = window.explorer;
  const doubt = new Doubt(await survey(), facts.parameters), [using] = Object.keys(doubt.survey.expectations);
  return places.map(place => doubt.numbers(normalized(facts.parameters, place), using));
}"""


def parameters(page: Page) -> dict[str, float]:
    settled(page)
    shown: dict[str, float] = request_of(page)["settings"][0]["parameters"]
    return shown


def press(page: Page, x: float, y: float, to: tuple[float, float] | None = None) -> None:
    """Press at a place of the drawing, in its own pixels, and drag."""
    page.locator(".runs").scroll_into_view_if_needed()
    box = page.locator(".runs").bounding_box()
    assert box is not None
    scale = box["width"] / 288
    page.mouse.move(box["x"] + x * scale, box["y"] + y * scale)
    page.mouse.down()
    if to:
        page.mouse.move(box["x"] + to[0] * scale, box["y"] + to[1] * scale)
    page.mouse.up()


def test_the_only_parameter_has_a_curve_and_its_interval(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    page.wait_for_function(WHOLE, timeout=60_000)
    points = page.locator(".runs .expectation").get_attribute("points")
    assert points is not None
    heights = np.array([float(point.split(",")[1]) for point in points.split()])
    places = [{"p": (i + 0.5) / 20} for i in range(20)]
    numbers = page.evaluate(NUMBERS, places)
    low, high = (edge(one[name] for one in numbers for name in ("low", "high")) for edge in (min, max))
    low = math.floor(low)
    high = max(math.ceil(high), low + 1)
    expected = [160 - 152 * (one["psnr"] - low) / (high - low) for one in numbers]  # higher is better
    assert heights == pytest.approx(expected, abs=1e-3)
    assert page.locator(".runs .run").count() == 8
    press(page, 200, 60)
    assert parameters(page)["p"] == pytest.approx((200 - 40) / 240, abs=1e-3)
    assert_shown(page, surrogate)
    page.locator(".runs .run.test").click(force=True)
    assert parameters(page) == {"p": 0.75}
    assert page.locator("#member").evaluate("e => e.selectedOptions[0].textContent") == "test-0: 0.75"


def test_two_parameters_have_a_map(page: Page, two: str) -> None:
    open_explorer(page, two)
    page.wait_for_function(WHOLE, timeout=60_000)
    facts: dict[str, Any] = page.evaluate("window.explorer.facts")
    names = [p["name"] for p in facts["parameters"]]
    assert page.locator(".runs rect").count() == 400
    press(page, 100, 100, to=(160, 84))
    shares = ((160 - 40) / 240, (160 - 84) / 152)
    expected = [shares[0], 100 ** shares[1]]  # the second is logarithmic
    assert [parameters(page)[name] for name in names] == pytest.approx(expected, rel=5e-3)
    ring = page.locator(".runs .here")
    assert float(ring.get_attribute("cx") or 0) == pytest.approx(160, abs=0.5)
    assert float(ring.get_attribute("cy") or 0) == pytest.approx(84, abs=0.5)
    member = facts["members"][3]
    page.locator(".runs .run").nth(3).click(force=True)
    assert [parameters(page)[name] for name in names] == member["values"]
