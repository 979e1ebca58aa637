"""Transfer functions of any number of points: edited by hand, keys, numbers and JSON, and drawn as the API draws them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from catalogs import TransferFunction
from surrogate import Surrogate
from surrogate.explore.request import frame_request
from tests.support.drawn_models import carrying
from tests.support.drawn_pages import opened
from tests.support.explored import addressed, assert_shown, drag, open_explorer, request_of, saved, settled, shown
from tests.support.field_blobs import FUNCTION

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def asked(page: Page) -> dict[str, Any]:
    (setting,) = request_of(page)["settings"]
    return dict(setting)


def opacities(page: Page) -> list[list[float]]:
    """The control points that are shown."""
    points: list[list[float]] = asked(page).get("function", {}).get("opacity_points") or [
        list(point) for point in FUNCTION.opacity_points
    ]
    return points


def double_click(page: Page) -> None:
    page.locator(".transfer").dblclick(position={"x": 120, "y": 20})


EDITS: dict[str, tuple[Callable[[Page], object], int]] = {
    "double click": (double_click, 5),
    "Enter": (lambda page: page.get_by_role("slider", name="Control point c2").press("Enter"), 5),
    "the button": (lambda page: page.get_by_role("button", name="Add", exact=True).click(), 5),
    "Delete": (lambda page: page.get_by_role("slider", name="Control point c1").press("Delete"), 3),
    "Remove": (lambda page: page.get_by_role("button", name="Remove", exact=True).click(), 3),
    "drag off": (lambda page: drag(page, ".transfer .handle >> nth=2", 0, 300), 3),
    "drag an end": (lambda page: drag(page, ".transfer .handle >> nth=3", -20, 20), 4),
    "arrows": (lambda page: page.get_by_role("slider", name="Control point 1").press("ArrowUp"), 4),
}


def test_points_are_added_removed_and_moved(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    base = assert_shown(page, surrogate)
    for way, (edit, count) in EDITS.items():
        edit(page)
        assert_shown(page, surrogate)
        assert len(opacities(page)) == count, way
        assert page.locator(".transfer .handle").count() == count, way
        assert asked(page)["visualization"] == {}, way
        page.get_by_role("button", name="Reset to base").click()
        np.testing.assert_array_equal(assert_shown(page, surrogate), base)


def test_numbers_and_colours_of_a_point_are_its_own(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    double_click(page)
    page.locator("#point-value").fill("1.75")
    page.keyboard.press("Enter")
    page.locator("#point-opacity").fill("0.875")
    page.keyboard.press("Enter")
    page.locator("#point-color").fill("#00ff80")
    assert_shown(page, surrogate)
    assert [1.75, 0.875] in opacities(page)
    colors = asked(page)["function"]["color_points"]
    assert [1.75, 0.0, 1.0, 128 / 255] in colors
    page.locator(".transfer .handle.selected").press("ArrowLeft")
    assert_shown(page, surrogate)
    (value,) = (value for value, *color in asked(page)["function"]["color_points"] if color == [0.0, 1.0, 128 / 255])
    assert value < 1.75  # the colour came along
    assert value in [point[0] for point in opacities(page)]
    page.get_by_role("button", name="plasma").click()
    assert_shown(page, surrogate)
    assert asked(page)["color_map"] == "plasma"
    assert "color_points" not in asked(page)["function"]


def test_a_link_a_reload_and_saved_files_hold_the_function(
    page: Page, explorer: str, surrogate: Surrogate, tmp_path: Path
) -> None:
    open_explorer(page, explorer)
    double_click(page)
    page.locator("#point-color").fill("#00ff80")
    addressed(page)
    before, picture = asked(page), assert_shown(page, surrogate)
    page.reload()
    settled(page)
    assert asked(page) == before
    np.testing.assert_array_equal(shown(page), picture)
    code = saved(page, "python", tmp_path).read_text()
    assert "surrogate.under(function, p=0.5)" in code
    assert "function" in saved(page, "png", tmp_path).name


def test_functions_are_copied_and_pasted(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    base = assert_shown(page, surrogate)
    page.locator(".exchange summary").click()
    text = page.locator("#function-json")
    page.get_by_role("button", name="Copy", exact=True).click()
    copied = json.loads(text.input_value())
    assert TransferFunction(**copied) == FUNCTION  # what catalogs store
    page.get_by_role("button", name="Copy for ParaView").click()
    (preset,) = json.loads(text.input_value())
    assert preset["Points"][:4] == [0.0, 0.0, 0.5, 0.0]
    assert len(preset["RGBPoints"]) == 4 * len(FUNCTION.color_points)
    page.get_by_role("button", name="Apply").click()
    np.testing.assert_allclose(assert_shown(page, surrogate), base, atol=2 / 255)  # colours in 8 bits
    paste = {"opacity_points": [[0, 0], [1, 0.9], [2, 0]]}
    text.fill(json.dumps(paste))
    page.get_by_role("button", name="Apply").click()
    assert_shown(page, surrogate)
    assert opacities(page) == paste["opacity_points"]
    normalized = {"ColorSpace": "Lab", "RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1], "Points": [0, 0, 0.5, 0, 1, 1, 0.5, 0]}
    text.fill(json.dumps([normalized]))
    page.get_by_role("button", name="Apply").click()
    assert_shown(page, surrogate)
    assert opacities(page) == [[0, 0], [3, 1]]
    said = page.locator(".exchange .refused").inner_text()
    assert "not in Lab" in said
    assert "stretched" in said


REFUSED = {
    "no JSON": "This is not JSON.",
    "[]": "holds no transfer function",
    '{"opacity_points": [[0, 0]]}': "has 1 points of opacity, not 2 to 256",
    '{"opacity_points": [[0, 0], [0, 1]]}': "do not increase",
    '{"opacity_points": [[0, 0], [1, 2]]}': "opacities outside 0 to 1",
    '{"opacity_points": 3}': "not lists of numbers",
    '[{"Points": [0, 0, 0.5, 0, null, "x", 0.5, 0]}]': "values other than numbers",
}


def test_what_is_no_function_is_refused_in_words(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    page.locator(".exchange summary").click()
    before = asked(page)
    for text, said in REFUSED.items():
        page.locator("#function-json").fill(text)
        page.get_by_role("button", name="Apply").click()
        assert said in page.locator(".exchange .refused").inner_text()
    assert asked(page) == before


def test_beyond_where_functions_were_trained_the_page_warns(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    warning = page.locator(".warning.outside:visible")
    assert warning.count() == 0
    drag(page, ".transfer .handle >> nth=1", 0, -60)
    assert_shown(page, surrogate)
    assert "dashed box" in warning.inner_text()


def test_a_page_alone_edits_functions_of_a_run_that_varied_none(page: Page, tmp_path: Path) -> None:
    surrogate = carrying()
    opened(page, surrogate, tmp_path)
    assert page.locator("[role=tab]").all_inner_texts() == ["Explore", "Compare", "Sweep"]  # nothing else can be shown
    before = shown(page)
    double_click(page)
    page.locator("#point-opacity").fill("0.01")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="cividis").click()
    page.wait_for_function("() => window.explorer.resting")
    message = request_of(page)
    request = frame_request(
        message | {"settings": [setting | {"using": ""} for setting in message["settings"]]}, surrogate
    )
    function = request.settings[0].transfer_function(surrogate)
    assert 0.01 in [opacity for _, opacity in function.opacity_points]
    under = surrogate.under(function, request.settings[0].parameters)
    expected = under.render(request.camera, background=request.background)[..., :3]
    assert np.abs(shown(page) - before).max() > 0.05
    assert np.abs(shown(page) - expected).max() < 4 / 255  # by scripts
    assert "function=" in page.evaluate("window.explorer.written")
