"""The camera as hands and numbers move it: the horizon stays level, and what is pointed at stays where it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from surrogate import Surrogate
from tests.support.explored import assert_shown, open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

CIRCLES = """async () => {
  const { turned, panned } = await import("/explore/orbit.js");
  let orbit = { direction: [0.6, 0, 0.8], up: [-0.8, 0, 0.6], distance: 2, target: [0, 0, 0], field: 40 };
  const first = orbit;
  for (let i = 0; i < 300; ++i) orbit = turned(orbit, 0.3 * Math.cos(i * Math.PI / 50), 0.3 * Math.sin(i * Math.PI / 50));
  return [first, orbit];
}"""
POLES = """async () => {
  const { turned, seenFrom } = await import("/explore/orbit.js");
  const orbit = { direction: [1, 0, 0], up: [0, 0, 1], distance: 2, target: [0, 0, 0], field: 40 };
  return [1, -1].map(sign => {
    const pole = turned(orbit, 0.4, sign * 9), preset = seenFrom(orbit, [0, 0, sign]);
    const [back, left, still] = [turned(pole, 0, -sign * Math.PI / 2), turned(preset, 0, -sign * 0.5), turned(preset, 0, 0)];
    return { pole, back, preset, left, still };
  });
}"""


def projected(camera: dict[str, Any], point: np.ndarray) -> np.ndarray:
    """The place (2,) at which a point (3,) is seen, in units of half the picture's height from its middle, right and up."""
    forward = np.subtract(camera["target"], camera["position"])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, camera["up"])
    right /= np.linalg.norm(right)
    seen = point - np.array(camera["position"])
    depth = (seen @ forward) * np.tan(np.radians(camera["field"]) / 2)
    return np.array([seen @ right, seen @ np.cross(right, forward)]) / depth


def test_circles_of_the_hand_do_not_roll_the_picture(page: Page, explorer: str) -> None:
    page.goto(explorer)
    first, last = page.evaluate(CIRCLES)
    for orbit in (first, last):
        level = np.cross(orbit["up"], orbit["direction"])
        assert abs(level[2]) < 1e-9
        assert orbit["up"][2] >= 0
        assert np.dot(orbit["up"], orbit["direction"]) == pytest.approx(0, abs=1e-12)


def test_poles_are_the_end_and_the_way_back_is_the_way_there(page: Page, explorer: str) -> None:
    page.goto(explorer)
    for sign, found in zip((1, -1), page.evaluate(POLES), strict=True):
        assert found["pole"]["direction"] == pytest.approx([0, 0, sign], abs=1e-12)
        assert found["back"]["direction"] == pytest.approx([np.cos(0.4), -np.sin(0.4), 0], abs=1e-6)
        assert found["back"]["up"] == pytest.approx([0, 0, 1], abs=1e-6)
        assert found["still"]["up"] == pytest.approx(found["preset"]["up"], abs=1e-12)  # a first touch turns nothing
        assert found["left"]["up"][1] > 0.8


def test_the_wheel_zooms_to_the_pointer(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    box = page.locator("#stage canvas").bounding_box()
    assert box is not None
    before = request_of(page)["camera"]
    place = np.array([box["x"] + 0.7 * box["width"], box["y"] + 0.3 * box["height"]])
    page.mouse.move(*place)
    page.mouse.wheel(0, -400)
    assert_shown(page, surrogate)
    after = request_of(page)["camera"]
    assert np.linalg.norm(np.subtract(after["position"], after["target"])) < 0.7 * np.linalg.norm(
        np.subtract(before["position"], before["target"])
    )
    middle = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    pointed = (place - middle) / (box["height"] / 2) * [1, -1]
    forward = np.subtract(before["target"], before["position"])
    right = np.cross(forward, before["up"])
    right /= np.linalg.norm(right)
    half = np.linalg.norm(forward) * np.tan(np.radians(before["field"]) / 2)
    point = np.array(before["target"]) + half * (pointed[0] * right + pointed[1] * np.array(before["up"]))
    np.testing.assert_allclose(projected(before, point), pointed, atol=1e-6)
    np.testing.assert_allclose(projected(after, point), pointed, atol=0.01)


def test_a_double_click_brings_what_is_there_to_the_middle(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    before = request_of(page)["camera"]
    box = page.locator("#stage canvas").bounding_box()
    assert box is not None
    page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] / 4)
    assert_shown(page, surrogate)
    after = request_of(page)["camera"]
    assert projected(before, np.array(after["target"])) == pytest.approx([0, 0.5], abs=0.01)


def test_the_camera_is_set_by_numbers(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    first = request_of(page)["camera"]
    page.get_by_text("Camera as numbers").click()
    for name, text in {"azimuth": "30", "elevation": "-20", "field-of-view": "5"}.items():
        page.locator(f"#camera-{name}").fill(text)
        page.keyboard.press("Enter")
    assert_shown(page, surrogate)
    camera = request_of(page)["camera"]
    away = np.subtract(camera["position"], camera["target"])
    distance = np.linalg.norm(away)
    azimuth, elevation = np.radians(30), np.radians(-20)
    expected = [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    np.testing.assert_allclose(away / distance, expected, atol=1e-6)
    assert camera["field"] == pytest.approx(5)
    size = [
        np.linalg.norm(np.subtract(c["position"], c["target"])) * np.tan(np.radians(c["field"]) / 2)
        for c in (first, camera)
    ]
    assert size[1] == pytest.approx(size[0], rel=1e-5)  # the volume keeps its size
    assert float(page.locator("#camera-distance").input_value()) == pytest.approx(distance, rel=1e-6)
    page.locator("#stage").press("ArrowRight")
    settled(page)
    assert float(page.locator("#camera-azimuth").input_value()) == pytest.approx(25, abs=1e-4)
