"""Two pictures side by side, seen from the same direction, and their difference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from catalogs.browse import CatalogServer
from catalogs.store.catalog import Catalog
from tests.support.browsed import composited, drag, image_of, shown, turned, visit
from tests.support.browsers import pixels

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

WHITE = (255, 255, 255)


def test_both_sides_show_the_pixels_of_the_catalog(grid: Catalog, server: CatalogServer, page: Page) -> None:
    fields = "mode=compare&member=m1&right.member=m4&right.appearance=second&view=9&background=white&size=actual"
    visit(page, f"{server.address}#{fields}")
    for side, of in enumerate((("m1", "first", 9), ("m4", "second", 9))):
        assert shown(page, side) == of
        assert np.abs(pixels(image_of(page, side)) - composited(grid, WHITE, of)).max() <= 1.0


def test_controls_change_the_side_that_was_chosen(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=9")
    page.get_by_role("tab", name="Compare").click()
    assert (shown(page)[0], shown(page, 1)[0]) == ("m0", "m5"), "what is farthest off, to begin with"
    page.locator("#parameter-0").press("ArrowRight")
    assert (shown(page)[0], shown(page, 1)[0]) == ("m2", "m5")
    page.get_by_role("button", name="Right", exact=True).click()
    assert page.locator("#member option:checked").text_content() == "m5: 2, 5"
    page.locator("#parameter-0").press("ArrowLeft")
    page.get_by_label("Appearance", exact=True).select_option("second")
    assert (shown(page), shown(page, 1)) == (("m2", "first", 9), ("m3", "second", 9))
    page.get_by_role("button", name="Swap left and right").click()
    assert (shown(page), shown(page, 1)) == (("m3", "second", 9), ("m2", "first", 9))
    page.get_by_role("tab", name="One picture").click()
    assert shown(page) == ("m3", "second", 9)
    assert image_of(page, 1).is_hidden()
    page.get_by_role("tab", name="Compare").click()
    assert shown(page, 1) == ("m2", "first", 9), "the right side is remembered"


def test_views_are_linked_whichever_side_is_turned(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#mode=compare&member=m0&right.member=m3&view=9")
    shown(page)
    drag(page, (650, 250), (120, 0))
    left = turned(page, ("m0", "first", 9))
    assert shown(page, 1)[2] == left[2]
    assert page.locator("#side-1").get_attribute("aria-pressed") == "true", "the controls follow the hand"
    page.locator(".stage").first.press("ArrowUp")
    assert turned(page, left)[2] == shown(page, 1)[2]
    assert page.locator("#side-0").get_attribute("aria-pressed") == "true"


def test_the_difference_is_that_of_the_pixels(grid: Catalog, server: CatalogServer, page: Page) -> None:
    fields = "mode=compare&member=m1&right.member=m4&view=9&background=white&size=actual&lines=off"
    visit(page, f"{server.address}#{fields}")
    left, right = (composited(grid, WHITE, (member, "first", 9)) for member in ("m1", "m4"))
    assert page.locator("#difference").is_hidden()
    for choice, gain in (("As it is", 1), ("× 4", 4)):
        page.get_by_label("Difference", exact=True).select_option(choice)
        page.wait_for_selector("#difference .stage[aria-busy=false]")
        screen = pixels(page.locator("#difference canvas")).astype(float)
        assert np.abs(screen - np.minimum(255.0, gain * np.abs(left - right))).max() <= 2.0 * gain
    page.locator("#member").select_option(label="m4: 2, -5")
    page.wait_for_selector("#difference .stage[aria-busy=false]")
    assert pixels(page.locator("#difference canvas")).max() == 0
