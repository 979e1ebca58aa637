"""Small multiples: the right pictures, only those in sight, and a way into each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from catalogs.browse import CatalogServer, write_page
from catalogs.store.catalog import Catalog
from tests.support.browsed import Picture, composited, picture_at, shown, visit
from tests.support.browsers import pixels
from tests.support.synthetic import synthetic_catalog

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def cells(page: Page) -> list[Picture]:
    """The images of the visible cells, row by row, once all are loaded."""
    page.wait_for_function("() => [...document.querySelectorAll('.cell img')].every(i => i.complete && i.naturalWidth)")
    found = page.locator(".cell").evaluate_all(
        "all => all.map(c => [parseInt(c.style.top), parseInt(c.style.left), c.querySelector('img').src])"
    )
    return [picture_at(source) for _, _, source in sorted(found)]


def test_the_grid_shows_every_member_with_its_pixels(grid: Catalog, server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#mode=grid&view=12&appearance=second&background=black&lines=off")
    assert cells(page) == [(f"m{i}", "second", 12) for i in range(6)]
    image = page.locator(".cell img").first
    image.evaluate("i => { i.style.width = i.style.height = '64px'; }")
    inside = np.s_[4:-4, 4:-4]  # its corners are round
    expected = composited(grid, (0, 0, 0), ("m0", "second", 12))
    assert np.abs(pixels(image)[inside] - expected[inside]).max() <= 1.0
    assert page.locator("#grid-count").inner_text() == "6 pictures at view 12"


def test_the_grid_goes_along_a_parameter(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#mode=grid&member=m3&view=12")
    page.get_by_label("Pictures", exact=True).select_option("Along x")
    assert cells(page) == [("m1", "first", 12), ("m3", "first", 12), ("m5", "first", 12)]
    assert page.locator(".cell .name").all_text_contents() == ["x 0", "x 1", "x 2"]
    page.locator("#parameter-1").press("ArrowLeft")
    assert cells(page)[0][0] == "m0", "through the present member"


def test_the_grid_goes_along_a_visualization_parameter(varied: Catalog, page: Page) -> None:
    visit(page, f"file://{write_page(varied.path)}#mode=grid&member=all&appearance=dvr&view=2")
    page.get_by_label("Pictures", exact=True).select_option("Along isovalue")
    assert cells(page) == [("all", f"iso={value}", 2) for value in ("0.2", "0.5", "0.8")]
    page.get_by_label("Pictures", exact=True).select_option("Members × appearances")
    assert page.locator("#grid-count").inner_text() == "87 pictures at view 2"
    page.get_by_label("Size", exact=True).locator("visible=true").select_option("Small")
    assert page.locator(".cell").first.evaluate("c => c.offsetWidth") == 96


def test_a_click_opens_a_picture_and_enter_too(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#mode=grid&view=12&lines=off")
    assert page.locator(".cell[aria-current]").get_attribute("aria-label") == "m0: 0, -5; first; train"
    page.locator(".cell").nth(4).click()
    assert page.get_by_role("tab", name="One picture").get_attribute("aria-selected") == "true"
    assert shown(page) == ("m4", "first", 12)
    page.get_by_role("tab", name="Grid").click()
    page.locator(".cell").first.focus()
    for key in ("End", "ArrowLeft", "Home", "ArrowRight", "ArrowRight", "ArrowDown", "ArrowUp"):
        page.keyboard.press(key)
    assert page.evaluate("document.activeElement.querySelector('.name').textContent") == "m0"
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    assert shown(page) == ("m1", "first", 12)


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    """Five hundred members of one view."""
    return synthetic_catalog(tmp_path_factory.mktemp("many") / "many.cdb", members=500, views=1, parameters=2)


def test_only_cells_in_sight_are_there(many: Catalog, page: Page) -> None:
    visit(page, f"file://{write_page(many.path)}#mode=grid&lines=off&cell=96")
    assert page.locator("#grid-count").inner_text() == "500 pictures at view 0"
    first = cells(page)
    assert first[0] == ("m000000", "pictures", 0)
    assert 20 < len(first) < 120
    page.locator(".cell").first.focus()
    page.keyboard.press("End")
    assert cells(page)[-1] == ("m000499", "pictures", 0)
    assert len(cells(page)) < 120
    page.mouse.move(400, 400)
    page.mouse.wheel(0, -100_000)
    page.wait_for_function("() => document.getElementById('grid').scrollTop === 0")
    assert cells(page) == first


def test_a_menu_of_many_members_offers_those_around_and_a_field_finds_the_rest(many: Catalog, page: Page) -> None:
    visit(page, f"file://{write_page(many.path)}")
    assert page.locator("#member option").count() == 400
    page.get_by_label("Find member").fill("473")
    page.keyboard.press("Enter")
    assert shown(page)[0] == "m000473"
    assert page.locator("#member option:checked").text_content().startswith("m000473")  # type: ignore[union-attr]
    assert page.locator("#member option").count() == 400
    assert page.locator("#member-place").inner_text() == "474 of 500"
    page.get_by_label("Find member").fill("nobody")
    page.keyboard.press("Enter")
    assert page.get_by_label("Find member").get_attribute("aria-invalid") == "true"
    assert shown(page)[0] == "m000473"


def test_a_catalog_may_move(grid: Catalog, tmp_path: Path, page: Page) -> None:
    """The page names its pictures from where it lies itself."""
    write_page(grid.path)
    moved = tmp_path / "elsewhere #1 %20.cdb"
    moved.symlink_to(grid.path)
    address = (moved / "index.html").as_uri()
    visit(page, f"{address}#mode=grid&view=3")
    assert len(cells(page)) == 6
    (grid.path / "index.html").unlink()
