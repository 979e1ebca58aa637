"""For everybody: contrast, names, keys, phones; and nothing that a second tab would disturb."""

from __future__ import annotations

import re
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest

from catalogs.browse import CatalogServer, write_page
from catalogs.store.catalog import Catalog
from catalogs.web import ASSETS
from tests.support.browsed import image_of, shown, visit
from tests.support.browsers import PHONE, NewPage, serious_findings

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

MODES = {
    "one": "",
    "brushed": "in.x=0.5..1.5",
    "compare": "mode=compare",
    "difference": "mode=compare&gain=4&background=white&size=actual",
    "grid": "mode=grid&background=checker",
    "along": "mode=grid&show=along x&lines=off",
}


@pytest.mark.parametrize("mode", MODES)
def test_axe_finds_nothing_serious(server: CatalogServer, page: Page, mode: str) -> None:
    visit(page, f"{server.address}#{MODES[mode]}")
    page.wait_for_selector("[aria-busy=false]", state="attached")
    page.get_by_text("Brushes as numbers").evaluate("e => { e.parentElement.open = true; }")
    assert serious_findings(page) == []


def test_axe_finds_nothing_serious_on_a_phone_or_in_a_catalog_of_many_settings(varied: Catalog, phone: Page) -> None:
    for mode in ("one", "compare", "grid"):
        visit(phone, f"file://{write_page(varied.path)}#mode={mode}")
        assert serious_findings(phone) == []


def contrast(first: str, second: str) -> float:
    """The contrast ratio of two colours "#rrggbb", as WCAG 2.2 defines it."""

    def luminance(color: str) -> float:
        parts = np.array([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ (0.2126, 0.7152, 0.0722))

    lighter, darker = sorted((luminance(first), luminance(second)), reverse=True)
    return (lighter + 0.05) / (darker + 0.05)


def test_the_colours_of_the_look_have_contrast() -> None:
    """Canvases and badges too, which axe does not see: 4.5:1 for text, 3:1 for marks and the borders of controls."""
    look = (ASSETS / "look.css").read_text()
    tokens = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", look))
    grounds = ("paper", "panel", "field")
    for text, ground in product(("ink", "quiet", "accent", "warning", "train", "validation", "test"), grounds):
        assert contrast(tokens[text], tokens[ground]) >= 4.5, (text, ground)
    for ground in grounds:
        assert contrast(tokens["edge"], tokens[ground]) >= 3.0, ground
    assert contrast(tokens["on-accent"], tokens["accent"]) >= 4.5


def test_every_control_is_reached_by_tab_and_shows_that_it_is(server: CatalogServer, page: Page) -> None:
    for mode in ("one", "compare", "grid"):
        visit(page, f"{server.address}#mode={mode}&member=m2")
        page.wait_for_selector("#plot[aria-busy=false]")
        reached: dict[int, str] = {}
        while True:
            page.keyboard.press("Tab")
            number, title, ring = page.evaluate(
                """() => { const e = document.activeElement, s = getComputedStyle(e);
                   return [[...document.querySelectorAll('*')].indexOf(e), e.outerHTML.slice(0, 80),
                     s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 2]; }"""
            )
            if number in reached or title.startswith("<body"):
                break
            assert ring, f"{title} has the focus and no ring"
            reached[number] = title
        expected = page.evaluate(
            """() => [...document.querySelectorAll('*')].map((e, i) => [i, e.outerHTML.slice(0, 80), e])
                .filter(([, , e]) => e.matches('button, select, input, summary, [tabindex]'))
                .filter(([, , e]) => e.checkVisibility() && !e.disabled && e.tabIndex >= 0).map(([i, title]) => [i, title])"""
        )
        assert [title for number, title in expected if number not in reached] == []


def test_keys_alone_go_everywhere(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=3")
    page.get_by_role("tab", name="One picture").focus()
    page.keyboard.press("ArrowRight")
    assert page.get_by_role("tab", name="Compare").get_attribute("aria-selected") == "true"
    page.locator("#side-1").focus()
    page.keyboard.press("Enter")
    page.locator("#member").focus()
    page.keyboard.press("Home")
    assert shown(page, 1)[0] == "m0"
    page.locator("#gain").focus()
    page.keyboard.press("ArrowDown")
    assert page.locator("#difference").is_visible()
    page.locator("#swap").press("Space")
    page.get_by_role("tab", name="Compare").press("End")
    assert page.get_by_role("tab", name="Grid").get_attribute("aria-selected") == "true"
    page.locator("#show").focus()
    page.keyboard.press("End")
    assert page.locator("#grid-count").inner_text() == "2 pictures at view 3", "along the second parameter"
    page.locator("#cell").focus()
    page.keyboard.press("End")
    assert page.locator(".cell").first.evaluate("c => c.offsetWidth") == 256
    page.get_by_role("tab", name="Grid").press("ArrowRight")
    assert page.get_by_role("tab", name="One picture").get_attribute("aria-selected") == "true"
    page.locator("button[data-background=white]").press("Enter")
    assert page.locator(".stage").first.evaluate("e => getComputedStyle(e).backgroundColor") == "rgb(255, 255, 255)"
    page.locator("button[data-size=actual]").press("Space")
    assert image_of(page).bounding_box()["width"] == 64  # type: ignore[index]
    page.locator("#lines-toggle").press("Enter")
    assert page.locator("#plot").is_hidden()


def test_a_phone_has_all_of_it(grid: Catalog, server: CatalogServer, phone: Page) -> None:
    visit(phone, f"{server.address}#member=m0&view=3")
    assert shown(phone) == ("m0", "first", 3)
    widest = "() => document.documentElement.scrollWidth"
    for tab in ("Compare", "Grid", "One picture"):
        phone.get_by_role("tab", name=tab).tap()
        assert phone.evaluate(widest) == PHONE["width"], "nothing sticks out"
    box = image_of(phone).bounding_box()
    assert box is not None
    assert box["width"] >= 300
    phone.locator("#parameter-0").scroll_into_view_if_needed()
    slider = phone.locator("#parameter-0").bounding_box()
    assert slider is not None
    assert slider["height"] >= 24
    phone.touchscreen.tap(slider["x"] + slider["width"] - 12, slider["y"] + slider["height"] / 2)
    assert shown(phone)[0] == "m4"
    for button in phone.locator("button:visible").all():
        size = button.bounding_box()
        assert size is not None
        assert min(size["width"], size["height"]) >= 24
    phone.locator("#plot").scroll_into_view_if_needed()
    axis = phone.locator(".axis").nth(3).bounding_box()
    assert axis is not None
    phone.touchscreen.tap(axis["x"] + axis["width"] / 2, axis["y"] + 46 + 0.75 * (axis["height"] - 86))
    phone.wait_for_function("() => document.getElementById('line-count').textContent === '2 of 12 lines brushed'")


def test_a_finger_turns_the_picture(server: CatalogServer, phone: Page) -> None:
    visit(phone, f"{server.address}#member=m0&view=20")
    assert shown(phone)[2] == 20
    client = phone.context.new_cdp_session(phone)
    for kind, x in (("touchStart", 150), *(("touchMove", 150 + 10 * i) for i in range(1, 12)), ("touchEnd", 0)):
        points = [] if kind == "touchEnd" else [{"x": x, "y": 250}]
        client.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert shown(phone)[2] != 20
    assert phone.evaluate("window.scrollY") == 0


def test_the_address_keeps_all_that_is_seen(server: CatalogServer, page: Page, new_page: NewPage) -> None:
    visit(
        page,
        f"{server.address}#member=none&view=999&background=url(x)&size=huge&appearance=second&mode=x&in.x=a..b&gain=3",
    )
    assert shown(page)[:2] == ("m0", "second")
    page.get_by_role("tab", name="Compare").click()
    page.locator("button[data-background=white]").click()
    page.locator("button[data-size=actual]").click()
    page.get_by_label("Difference", exact=True).select_option("× 4")
    page.get_by_role("slider", name="x, most of the brush").press("PageDown")
    page.get_by_role("slider", name="y<b>, least of the brush").press("PageUp")
    page.get_by_role("button", name="Right", exact=True).click()
    page.locator("#parameter-0").press("ArrowLeft")
    page.wait_for_url(re.compile(r"right\.member=m3.*active=1.*gain=4.*in\.x=0\.\.1\.8"))
    seen, said = (shown(page), shown(page, 1)), page.locator("#line-count").inner_text()
    other = new_page()
    visit(other, page.url)
    assert (shown(other), shown(other, 1)) == seen
    assert other.locator("#line-count").inner_text() == said
    assert other.locator("#side-1").get_attribute("aria-pressed") == "true"
    assert other.locator("#difference").is_visible()
    assert other.locator(".stage").first.get_attribute("data-size") == "actual"


def test_two_tabs_leave_each_other_alone(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m1&view=5")
    other = page.context.new_page()
    visit(other, f"{server.address}#member=m4&view=7&mode=compare")
    page.get_by_label("Next member").click()
    page.get_by_role("slider", name="x, most of the brush").press("PageDown")
    other.locator(".stage").first.press("ArrowRight")
    other.locator("button[data-background=white]").click()
    before = shown(other)
    assert shown(page) == ("m2", "first", 5)
    page.wait_for_url(re.compile(r"member=m2.*in\.x="))
    other.wait_for_url(re.compile(f"view={before[2]}&.*background=white"))
    page.reload()
    other.reload()
    assert shown(page) == ("m2", "first", 5)
    assert shown(other) == before
    assert page.locator("button[data-background=dark]").get_attribute("aria-pressed") == "true"
    assert page.locator("#line-count").inner_text() == "8 of 12 lines brushed"
    assert other.locator("#line-count").inner_text() == "12 lines"
    assert page.evaluate("[localStorage.length, document.cookie]") == [0, ""]
