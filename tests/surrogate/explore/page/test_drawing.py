"""A browser that has the model draws what the program draws, and the program what it can't."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from surrogate import Surrogate
from tests.support.explored import drawn, go, open_explorer, settled, shown

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def said(page: Page) -> str:
    text: str = page.locator("#status").inner_text()
    return text


@pytest.mark.parametrize(
    "state", ["", "a.p.p=0.3", "a.show=isovalue&a.isovalue=0.3", "a.show=transfer_function&a.c1=1.2,0.5"]
)
def test_the_browser_draws_what_the_program_draws(page: Page, explorer: str, surrogate: Surrogate, state: str) -> None:
    open_explorer(page, explorer, f"drawn=browser&full=256&{state}")
    assert "in this browser" in said(page)
    difference = shown(page) - drawn(page, surrogate)
    assert np.abs(difference).max() < 2.1 / 255  # scripts agree to 80 dB, and round to 8 bits
    assert np.sqrt((difference**2).mean()) < 0.5 / 255
    assert page.locator("#expected").inner_text() != ""


def test_by_default_a_machine_without_a_graphics_card_lets_the_program_draw(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    assert "in this browser" not in said(page)
    page.locator("#drawn").select_option("browser")
    settled(page)
    assert "in this browser" in said(page)
    page.locator("#drawn").select_option("program")
    settled(page)
    assert "in this browser" not in said(page)


def test_two_settings_and_stored_pictures(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, "drawn=browser&full=256&mode=compare&a.p.p=0.3&b.p.p=0.8")
    pictures = [drawn(page, surrogate, number) for number in (0, 1)]
    psnr = -10 * np.log10(np.mean((pictures[0] - pictures[1]) ** 2))
    assert float(page.locator("#compared").inner_text().split()[1]) == pytest.approx(psnr, abs=0.05)
    go(page, "drawn=browser&mode=compare&against=truth&a.p.p=0.5")  # which only the program has
    settled(page)
    assert "in this browser" not in said(page)
    assert "PSNR" in page.locator("#compared").inner_text()
