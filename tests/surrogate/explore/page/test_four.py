"""Four settings under one camera: each is changed by itself, kept in the link, and may come from snapshots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from tests.support.browsers import serious_findings
from tests.support.explored import addressed, assert_shown, go, open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def shown(page: Page) -> list[float]:
    return [setting["parameters"]["p"] for setting in request_of(page)["settings"]]


def test_four_settings_share_a_camera_and_a_link(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, "mode=compare&a.p.p=0.3&b.p.p=0.8")
    page.locator("#against").select_option("three")
    settled(page)
    assert shown(page) == [0.3, 0.8, 0.3, 0.3]
    page.locator("#edit-D").click()
    page.locator("#parameter-0").press("End")
    page.locator("#stage").press("ArrowLeft")
    for number in range(4):
        assert_shown(page, surrogate, number)
    values = shown(page)
    assert values[:3] == [0.3, 0.8, 0.3]
    assert values[3] > 1
    captions = page.locator("#stage figcaption")
    assert captions.nth(1).inner_text().startswith("B p = 0.8\n")
    assert "far from all runs" in captions.nth(3).inner_text() or "never shown" in captions.nth(3).inner_text()
    assert serious_findings(page) == []
    addressed(page)
    open_explorer(page, page.url.partition("#")[0], page.url.partition("#")[2])
    assert shown(page) == values
    assert page.locator("#edit-D").get_attribute("aria-pressed") == "true"
    page.locator("#against").select_option("setting")
    settled(page)
    assert shown(page) == [0.3, 0.8]
    assert page.locator("#edit-B").get_attribute("aria-pressed") == "true"


def test_snapshots_are_taken_and_one_is_copied_to_the_others(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    for value in (0.1, 0.4, 0.9):
        go(page, f"#a.p.p={value}")
        settled(page)
        page.locator("#keep").click()
    go(page, "#mode=compare&against=three&a.p.p=0.7")
    settled(page)
    page.locator("#take-snapshots").click()
    settled(page)
    assert shown(page) == [0.1, 0.4, 0.9, 0.7]
    page.get_by_role("button", name="Copy A to the others").click()
    settled(page)
    assert shown(page) == [0.1] * 4


def test_a_link_names_a_setting_that_is_not_compared(page: Page, explorer: str) -> None:
    open_explorer(page, explorer, "mode=compare&active=c")
    assert "active = c is unknown here" in page.locator("#note").inner_text()
