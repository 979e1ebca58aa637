"""A parameter plays between its bounds until it is stopped."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from tests.support.explored import assert_shown, open_explorer, request_of

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def test_a_parameter_plays_until_it_is_stopped(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, "a.p.p=0.99")
    play = page.get_by_role("button", name="Play p")
    play.click()
    page.wait_for_function("() => window.explorer.state.settings[0].parameters.p === 1")
    page.wait_for_function("() => window.explorer.state.settings[0].parameters.p < 0.9")  # and back
    assert play.get_attribute("aria-pressed") == "true"
    play.click()
    assert_shown(page, surrogate)
    stopped = request_of(page)["settings"][0]["parameters"]["p"]
    assert 0 <= stopped <= 1
    page.wait_for_timeout(100)
    assert request_of(page)["settings"][0]["parameters"]["p"] == stopped
    play.click()
    page.locator("#mode-compare").click()  # builds the controls anew, which stops it
    still = request_of(page)["settings"][0]["parameters"]["p"]
    page.wait_for_timeout(100)
    assert request_of(page)["settings"][0]["parameters"]["p"] == still
