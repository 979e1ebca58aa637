"""Gaussians fitted for other viewers are saved from the page, which says how far they are, and may be ended."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from surrogate.explore.exporting import exports
from tests.support.browsers import serious_findings
from tests.support.explored import open_explorer, saved

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

pytestmark = pytest.mark.slow
LONG = 100_000  # steps


def test_a_fit_says_how_far_it_is_and_is_ended(
    page: Page, explorer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exports, "REFIT_STEPS", LONG)

    def more(route: Route) -> None:  # so that it lasts however slow the page is
        request = json.loads(route.request.post_data or "")
        route.continue_(post_data=json.dumps(request | {"refit": LONG}))

    page.route("**/export?ticket=*", more)
    open_explorer(page, explorer)
    page.locator("#export-kind").select_option("spz")
    page.locator("#export").click()
    page.wait_for_function("() => document.querySelector('#making progress').value > 0")
    assert page.locator("#making span").inner_text().endswith(f" of {LONG}")
    assert page.locator("#export").is_disabled()
    page.locator("#mode-compare").click()  # the panels are built anew: the file is made all the same
    page.wait_for_function("() => document.querySelector('#making progress')?.value > 0")
    assert page.locator("#export").is_disabled()
    assert serious_findings(page) == []
    page.locator("#cancel-export").click()
    page.wait_for_function("() => document.getElementById('alert').textContent === 'Nothing was saved.'")
    assert not page.locator("#making").is_visible()
    assert saved(page, "png", tmp_path).stat().st_size > 1000  # nothing is in its way


def test_fitted_gaussians_are_saved(page: Page, explorer: str, tmp_path: Path) -> None:
    asked: list[int] = []

    def fewer(route: Route) -> None:
        request = json.loads(route.request.post_data or "")
        asked.append(request["refit"])
        route.continue_(post_data=json.dumps(request | {"refit": 3}))

    page.route("**/export?ticket=*", fewer)
    open_explorer(page, explorer)
    assert saved(page, "glb", tmp_path).read_bytes()[:4] == b"glTF"
    assert asked == [3000]
