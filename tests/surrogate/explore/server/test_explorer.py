"""The explorer opens and follows one hand; `test_in_browser.py` operates all of it, more slowly."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from surrogate import Surrogate
from tests.support.explored import assert_shown, open_explorer

if TYPE_CHECKING:
    from playwright.sync_api import Page


def test_the_explorer_opens_and_follows_a_key(page: Page, explorer: str, run_folder: Path) -> None:
    surrogate = Surrogate.load(run_folder / "surrogate")
    open_explorer(page, explorer)
    first = assert_shown(page, surrogate)
    page.locator("#parameter-0").press("ArrowRight")
    page.locator("#stage").press("ArrowUp")
    assert np.abs(assert_shown(page, surrogate) - first).max() > 2 / 255
