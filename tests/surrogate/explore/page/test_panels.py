"""Controls stay where they are while others are used, and never speak of what is no longer shown."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from tests.support.explored import assert_shown, open_explorer, settled
from tests.support.explorer_process import address_in, command

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
FOCUS = "document.activeElement.id"


@pytest.mark.parametrize(
    ("state", "menu", "value"),
    [
        ("", "background", "#ffffff"),
        ("", "full", "256"),
        ("mode=compare", "against", "truth"),
        ("mode=sweep", "sweep-count", "3"),
        ("mode=sweep&sweep.second=isovalue&a.show=isovalue", "sweep-rows", "3"),
    ],
)
def test_a_menu_keeps_the_focus(
    page: Page, explorer: str, surrogate: Surrogate, state: str, menu: str, value: str
) -> None:
    open_explorer(page, explorer, state)
    page.locator(f"#{menu}").focus()
    page.locator(f"#{menu}").select_option(value)
    assert_shown(page, surrogate)
    assert page.evaluate(FOCUS) == menu
    assert page.locator(f"#{menu}").input_value() == value


def test_a_player_goes_on_beside_menus(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    play = page.get_by_role("button", name="Play p")
    play.click()
    page.locator("#background").select_option("#ffffff")
    page.wait_for_timeout(200)
    assert play.get_attribute("aria-pressed") == "true"
    play.click()


def test_the_menu_of_members_names_the_one_that_is_shown(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, "a.p.p=0.75")
    menu = page.locator("#member")
    named = "e => e.selectedOptions[0].textContent"
    assert menu.evaluate(named) == "test-0: 0.75"
    page.locator("#parameter-0").press("ArrowRight")
    assert_shown(page, surrogate)
    assert menu.evaluate(named) == "choose…"
    page.locator("#parameter-0").press("ArrowLeft")
    assert menu.evaluate(named) == "test-0: 0.75"


def test_while_something_moves_the_line_is_silent(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    page.wait_for_function("() => document.getElementById('expected').textContent.includes('dB')", timeout=60_000)
    page.evaluate(
        """() => { window.said = []; new MutationObserver(() => window.said.push(document.getElementById("expected").textContent))
        .observe(document.getElementById("expected"), { childList: true, characterData: true, subtree: true }); }"""
    )
    page.locator("#parameter-0").press("ArrowRight")
    settled(page)
    said = page.evaluate("window.said")
    assert said[0] == ""
    assert "dB" in said[-1]


def test_an_explorer_that_hangs_is_said_and_waited_for(
    page: Page, own_run: Path, surrogate: Surrogate, complaints: list[str]
) -> None:
    with command(own_run) as (process, line):
        open_explorer(page, address_in(line))
        os.kill(process.pid, signal.SIGSTOP)
        try:
            page.locator("#parameter-0").press("ArrowRight")
            page.locator("#lost").wait_for(timeout=20_000)
            assert "No answer for" in page.locator("#lost").inner_text()
        finally:
            os.kill(process.pid, signal.SIGCONT)
        page.locator("#lost").wait_for(state="hidden", timeout=60_000)
        assert_shown(page, surrogate)
        page.close()
    complaints.clear()
