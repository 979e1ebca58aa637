"""A program that stops is waited for: started anew it has the same address, and the page goes on where it was."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from tests.support.explored import assert_shown, open_explorer, request_of
from tests.support.explorer_process import address_in, command

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def test_the_page_goes_on_when_its_program_is_started_again(
    page: Page, own_run: Path, surrogate: Surrogate, complaints: list[str]
) -> None:
    with command(own_run) as (process, line):
        address = address_in(line)
        open_explorer(page, address, "a.p.p=0.3")
        process.send_signal(signal.SIGINT)
        lost = page.locator("#lost")
        lost.wait_for()
        assert "The explorer has stopped" in lost.inner_text()
        process.wait(timeout=60)
        bar, said = page.locator("#top").bounding_box(), lost.bounding_box()
        assert bar is not None
        assert said is not None
        assert said["y"] >= bar["y"] + bar["height"]
        page.locator("#export").click()
        page.get_by_text("Nothing was saved: the explorer has stopped.").wait_for()
    page.locator("#parameter-0").press("ArrowRight")  # what is set meanwhile is shown later
    with command(own_run) as (process, line):
        assert address_in(line) == address
        lost.wait_for(state="hidden", timeout=60_000)
        assert_shown(page, surrogate)
        assert request_of(page)["settings"][0]["parameters"] == {"p": 0.31}
        with command(own_run) as (_, another):  # a second one of the same run has another port
            assert address_in(another) != address
    page.close()  # it complains no more
    complaints.clear()  # browsers tell of every attempt
