"""Parallel coordinates: lines where the values are, brushes that select, lines that choose."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from catalogs.browse import CatalogServer, write_page
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.catalogs.browse.conftest import GRID, grid_plan
from tests.support.browsed import drag, option_texts, shown, slider_box, visit
from tests.support.browsers import pixels

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def axis_at(page: Page, number: int, part: float) -> tuple[float, float]:
    """The place in the window where an axis has the value at `part` (0 low, 1 high) of its range."""
    box = page.locator(".axis").nth(number).bounding_box()
    assert box is not None
    top, bottom = box["y"] + 46, box["y"] + box["height"] - 40
    return box["x"] + box["width"] / 2, bottom - part * (bottom - top)


def brush(page: Page, number: int, low: float, high: float) -> None:
    """Drag over an axis from one part of its range to another."""
    start, end = axis_at(page, number, low), axis_at(page, number, high)
    drag(page, start, (0.0, end[1] - start[1]))


def counted(page: Page, said: str) -> None:
    """Wait until the page says how many lines are brushed."""
    page.wait_for_function("said => document.getElementById('line-count').textContent === said", arg=said)


def members(page: Page) -> list[str]:
    """The members that the menu offers, by name."""
    return sorted(text.split(":")[0] for text in option_texts(page, "member"))


def test_a_drag_on_an_axis_brushes_members(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=3")
    assert page.locator(".axis-name").all_text_contents() == ["x", "y<b>", "appearance", "split"]
    counted(page, "12 lines")
    brush(page, 0, 0.4, 0.9)
    counted(page, "4 of 12 lines brushed")
    assert members(page) == ["m0", "m2", "m3"], "the brushed, and the present one"
    assert page.locator("#member-place").inner_text() == "not brushed"
    page.get_by_label("Next member").click()
    assert shown(page) == ("m2", "first", 3)
    assert members(page) == ["m2", "m3"]
    brush(page, 1, 0.5, 1.0)
    counted(page, "2 of 12 lines brushed")
    assert members(page) == ["m2", "m3"]
    page.get_by_role("tab", name="Grid").click()
    assert page.locator(".cell .name").all_text_contents() == ["m3"]
    page.get_by_role("button", name="Reset brushes").click()
    counted(page, "12 lines")
    assert page.locator(".cell .name").all_text_contents() == [f"m{i}" for i in range(6)]


def test_a_brush_is_moved_narrowed_and_taken_away(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=3")
    brush(page, 0, -0.2, 0.2)
    counted(page, "4 of 12 lines brushed")
    start, end = axis_at(page, 0, 0.1), axis_at(page, 0, 0.55)
    drag(page, start, (0.0, end[1] - start[1]))
    page.wait_for_selector("#member-place >> text=not brushed")
    page.get_by_label("Next member").click()
    assert members(page) == ["m2", "m3"], "moved to the next value of x"
    top = page.get_by_role("slider", name="x, most of the brush")
    assert 1.2 < float(top.get_attribute("aria-valuenow") or 0) < 1.4
    drag(page, axis_at(page, 0, 0.65), (0.0, axis_at(page, 0, 1.1)[1] - axis_at(page, 0, 0.65)[1]))
    page.wait_for_function("() => document.querySelectorAll('#member option').length === 4")
    assert members(page) == ["m2", "m3", "m4", "m5"], "its upper end was dragged"
    page.mouse.click(*axis_at(page, 0, 0.05))
    counted(page, "12 lines")


def test_categories_are_brushed_by_a_click(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=3")
    page.mouse.click(*axis_at(page, 3, 0.25))
    counted(page, "2 of 12 lines brushed")
    assert members(page) == ["m0", "m5"], "the test member"
    page.mouse.click(*axis_at(page, 3, 0.25))
    counted(page, "12 lines")
    page.mouse.click(*axis_at(page, 2, 0.25))
    counted(page, "6 of 12 lines brushed")


def test_a_brush_by_keys(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=3")
    top = page.get_by_role("slider", name="x, most of the brush")
    top.press("PageDown")
    counted(page, "8 of 12 lines brushed")
    assert float(top.get_attribute("aria-valuenow") or 0) == pytest.approx(1.8)
    bottom = page.get_by_role("slider", name="x, least of the brush")
    bottom.press("ArrowUp")
    counted(page, "4 of 12 lines brushed")
    assert bottom.get_attribute("aria-valuetext") == "0.02"
    bottom.press("Home")
    counted(page, "8 of 12 lines brushed")
    top.press("Escape")
    counted(page, "12 lines")
    page.get_by_role("slider", name="split, most of the brush").press("ArrowDown")
    counted(page, "2 of 12 lines brushed")


def test_a_brush_by_numbers(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=3")
    page.get_by_text("Brushes as numbers").click()
    page.get_by_label("x from").fill("1")
    page.keyboard.press("Enter")
    counted(page, "8 of 12 lines brushed")
    page.get_by_label("y<b> to").fill("0")
    page.keyboard.press("Enter")
    counted(page, "4 of 12 lines brushed")
    page.get_by_label("x from").fill("")
    page.keyboard.press("Enter")
    counted(page, "6 of 12 lines brushed")


def test_lines_run_through_the_values(server: CatalogServer, page: Page) -> None:
    """The present member's line is the brightest thing where its values are on the axes."""
    for number, (x, y) in enumerate(GRID):
        visit(page, f"{server.address}#member=m{number}&view=3")
        page.wait_for_selector("#plot[aria-busy=false]")
        picture = pixels(page.locator("#plot")).min(axis=2)
        box = page.locator("#plot").bounding_box()
        assert box is not None
        left, right = axis_at(page, 0, x / 2), axis_at(page, 1, (y + 5) / 10)
        for part in (0.25, 0.5, 0.75):
            column = round(left[0] + part * (right[0] - left[0]) - box["x"])
            row = round(left[1] + part * (right[1] - left[1]) - box["y"])
            assert picture[row - 2 : row + 3, column].max() > 200


def test_the_pointer_reads_a_line_and_a_click_chooses_it(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=3")
    start, end = axis_at(page, 0, 1.0), axis_at(page, 1, 0.0)
    between = start[0] * 0.85 + end[0] * 0.15, start[1] * 0.85 + end[1] * 0.15
    page.mouse.move(*between)
    assert page.locator("#line-title").inner_text() == "m4, first, x 2, y<b> -5"
    page.mouse.click(*between)
    assert shown(page) == ("m4", "first", 3)
    page.mouse.move(*axis_at(page, 0, 0.5))
    assert page.locator("#line-title").inner_text() == "", "an axis is for brushing"
    brush(page, 0, -0.1, 0.6)
    counted(page, "8 of 12 lines brushed")
    page.mouse.move(*between)
    assert page.locator("#line-title").inner_text() == "", "what is not brushed is not chosen"


def test_grey_lines_are_those_that_are_not_brushed(server: CatalogServer, page: Page) -> None:
    """Of the lines that leave the top of the first axis none stays coloured when the brush leaves them out."""
    visit(page, f"{server.address}#member=m0&view=3&in.x=0..1.5")
    page.wait_for_selector("#plot[aria-busy=false]")
    canvas = page.locator("#brushed-lines")
    drawn = canvas.evaluate(
        """c => { const scale = c.width / c.clientWidth, pen = c.getContext('2d');
           const sum = y => pen.getImageData(70 * scale, y * scale, 20 * scale, 4 * scale).data.reduce((a, b) => a + b, 0);
           return [sum(44), sum(c.clientHeight - 44)]; }"""
    )
    assert drawn[0] == 0
    assert drawn[1] > 0


def test_lines_of_appearances_without_a_value_run_below_the_axis(varied: Catalog, page: Page) -> None:
    visit(page, f"file://{write_page(varied.path)}#member=all&appearance=dvr&view=3")
    names = page.locator(".axis-name").all_text_contents()
    assert names == [*("x", "y<b>", "isovalue", "c1_value", "c1_opacity", "c2_value", "c2_opacity", "appearance")], (
        "one split only: no axis of it"
    )
    counted(page, "87 lines")
    brush(page, 2, -0.1, 0.6)
    counted(page, "5 of 87 lines brushed")
    page.get_by_role("tab", name="Grid").click()
    page.get_by_label("Pictures", exact=True).select_option("Members × appearances")
    page.wait_for_selector(".cell")
    assert np.unique(page.locator(".cell .values").all_text_contents()).tolist() == [
        "iso=0.2 (isovalue 0.2)",
        "iso=0.5 (isovalue 0.5)",
    ]


def test_axes_and_sliders_follow_a_logarithmic_scale(tmp_path: Path, page: Page) -> None:
    """Five decades at equal distances; on a linear scale all but the last would lie in the lowest tenth."""
    space = ParameterSpace((Parameter("nu", 1e-5, 1e-1, "m²/s", "log"), Parameter("y", 0.0, 1.0)))
    cameras = tuple(orbit((1.0, 0.0, 0.0), 1.0, width=8, height=8, frequency=1))
    views = {"cameras": cameras, "view_splits": tuple(view_splits(12)), "appearances": (ImportedImages("first"),)}
    made = Catalog.create(tmp_path / "log.cdb", grid_plan(space=space, **views))
    for number in range(5):
        with made.begin_member(f"m{number}", {"nu": 10.0 ** (number - 5), "y": 0.5}) as writer:
            for view in range(12):
                writer.write_image("first", view, np.zeros((8, 8, 4), np.uint8))
    visit(page, f"file://{write_page(made.path)}#member=m4&view=3")
    left, length, y = slider_box(page, 0)
    for number in (2, 1, 3):
        page.mouse.click(left + number / 4 * length, y)
        assert shown(page)[0] == f"m{number}"
    brush(page, 0, 0.4, 0.8)
    counted(page, "2 of 5 lines brushed")
    assert members(page) == ["m2", "m3"]
    low, high = (float(page.get_by_label(f"nu {end}").input_value()) for end in ("from", "to"))
    assert (low, high) == pytest.approx((10**-3.4, 10**-1.8), rel=0.1)

    def is_written(address: str) -> bool:
        """Addresses follow a little later than brushes."""
        said = re.search(r"in\.nu=([^&]+)\.\.([^&]+)", address)
        return said is not None and np.allclose([float(end) for end in said.groups()], [low, high], rtol=1e-4)

    page.wait_for_url(is_written)
    visit(page, page.url)
    counted(page, "2 of 5 lines brushed")
