"""The room around the picture: what to trust, groups that fold, keys, themes, and a phone's sheet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from tests.support.browsers import DESKTOP, PHONE, NewPage, serious_findings
from tests.support.explored import addressed, assert_shown, go, open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
WIDTHS = "[document.getElementById('stage').clientWidth, innerWidth]"


def test_what_to_trust_is_said_with_the_nearest_run_and_its_picture(
    page: Page, explorer: str, surrogate: Surrogate
) -> None:
    open_explorer(page, explorer, "a.p.p=0.52")
    page.wait_for_function("() => document.getElementById('expected').textContent.includes('dB')")
    words = page.locator("#expected strong").text_content()
    assert words in ("like a run that was simulated:", "between runs:")
    assert page.locator(".sign.like, .sign.between").count() == 1
    assert page.locator("#nearest-run").inner_text() == "Nearest run: p = 0.5"
    page.locator("#show-nearest").click()
    settled(page)
    assert page.locator("#mode-compare").get_attribute("aria-selected") == "true"
    page.wait_for_function("() => document.getElementById('compared').textContent.startsWith('PSNR')")
    assert "member train-1" in page.locator("#stage figcaption").nth(1).inner_text()
    page.locator("#undo").click()
    page.wait_for_function("() => document.body.dataset.mode === 'view'")
    open_explorer(page, explorer, "a.p.p=1.5")
    assert page.locator(".sign.never").count() == 1
    assert "warning" in (page.locator("#expected").get_attribute("class") or "")


def test_groups_fold_and_stay_folded(page: Page, explorer: str) -> None:
    page.goto(explorer)
    settled(page)
    folded = page.locator(".group:not([open]) > summary")
    first = set(folded.all_inner_texts())
    assert {"View", "Display", "Model"} <= first
    page.get_by_text("Display", exact=True).click()
    page.locator("summary", has_text="Simulation parameters").press("Enter")
    page.locator("#mode-compare").click()  # which builds the controls anew
    assert page.locator("#background").is_visible()
    assert page.locator("#parameter-0").is_hidden()
    page.reload()
    settled(page)
    assert set(folded.all_inner_texts()) == {"Simulation parameters", *first} - {"Display"}


def test_panels_fold_away_for_the_picture(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    narrow, window = page.evaluate(WIDTHS)
    page.locator("#stage").press("p")
    assert_shown(page, surrogate)
    wide, _ = page.evaluate(WIDTHS)
    assert narrow < wide > window - 20
    assert page.locator("aside").is_hidden()
    page.reload()
    settled(page)
    assert page.locator("aside").is_hidden()
    page.locator("#toggle-panels").click()
    assert page.locator("aside").is_visible()
    assert page.locator("#toggle-panels").get_attribute("aria-pressed") == "true"


def test_keys_are_listed_and_typing_is_not_a_key(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    page.locator("#stage").press("?")
    dialog = page.get_by_role("dialog", name="Keys")
    assert dialog.is_visible()
    assert "whole screen" in dialog.inner_text()
    assert serious_findings(page) == []
    page.keyboard.press("Escape")
    assert dialog.is_hidden()
    page.locator("#show-keys").click()
    dialog.get_by_role("button", name="Close").click()
    page.locator(".exchange summary").click()
    page.locator("#function-json").press_sequentially("pfl?")
    assert dialog.is_hidden()
    assert page.locator("aside").is_visible()
    assert page.locator("#function-json").input_value() == "pfl?"


def test_the_whole_screen_is_one_key_away(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    page.locator("#stage").press("f")
    page.wait_for_function("() => document.fullscreenElement")
    page.locator("#toggle-screen").click()
    page.wait_for_function("() => !document.fullscreenElement")


def test_every_pixel_of_the_window_can_be_drawn(new_page: NewPage, explorer: str, surrogate: Surrogate) -> None:
    page = new_page(device_scale_factor=2, viewport={"width": 700, "height": 300})
    open_explorer(page, explorer, full=0)
    usual = assert_shown(page, surrogate).shape
    assert usual[0] * usual[1] == pytest.approx(512**2, rel=0.02)
    page.locator("#full").select_option("every pixel")
    picture = assert_shown(page, surrogate)
    width, height = page.evaluate("[(c => c.clientWidth)(stage), (c => c.clientHeight)(stage)]")
    assert picture.shape[:2] == pytest.approx((2 * height, 2 * width), abs=2)
    addressed(page)
    assert "full=1&" in page.url + "&"


@pytest.mark.parametrize("viewport", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_light_is_as_clean_as_dark(new_page: NewPage, explorer: str, viewport: dict[str, int]) -> None:
    page = new_page(color_scheme="light", viewport=viewport)
    open_explorer(page, explorer)
    for state in ("a.show=isovalue", "mode=compare&b.p.p=0.9", "mode=sweep&sweep.count=3", ""):
        go(page, f"full=256&{state}")
        settled(page)
        assert page.evaluate("document.documentElement.dataset.theme") == "light"
        assert serious_findings(page) == [], state
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), state


def test_themes_switch_and_a_link_keeps_its_background(new_page: NewPage, explorer: str, surrogate: Surrogate) -> None:
    page = new_page(color_scheme="light")
    open_explorer(page, explorer, full=0)
    assert request_of(page)["background"] == "#ffffff"
    page.locator("#parameter-0").press("ArrowRight")
    addressed(page)
    link = page.url
    assert "background=%23ffffff" in link
    page.locator("#toggle-theme").click()
    assert_shown(page, surrogate)
    assert request_of(page)["background"] == "#101216"
    addressed(page)
    page.reload()
    settled(page)
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    dark = new_page()
    open_explorer(dark, explorer, link.partition("#")[2])
    assert request_of(dark)["background"] == "#ffffff"
    dark.emulate_media(color_scheme="light")  # the system changes its mind
    dark.wait_for_function("() => document.documentElement.dataset.theme === 'light'")


def test_a_phone_has_the_picture_above_and_the_sheet_below(phone: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(phone, explorer)
    assert_shown(phone, surrogate)
    stage, sheet, bar = (phone.locator(name).bounding_box() for name in ("#stage", "aside", "#top"))
    assert stage is not None
    assert sheet is not None
    assert bar is not None
    assert stage["y"] + stage["height"] <= bar["y"] + 1
    assert bar["y"] + bar["height"] <= sheet["y"] + 1
    assert sheet["y"] + sheet["height"] <= 845
    assert bar["height"] < 60
    phone.locator("#export").scroll_into_view_if_needed()
    assert phone.locator("#export").is_visible()
    assert serious_findings(phone) == []
