"""Steps are undone and done again, by buttons, keys and the browser's Back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from tests.support.explored import addressed, assert_shown, drag, open_explorer, request_of

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def test_gestures_are_undone_one_by_one_and_done_again(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    undo, redo = page.locator("#undo"), page.locator("#redo")
    assert undo.is_disabled()
    assert redo.is_disabled()
    requests = [request_of(page)]
    for operate in (
        lambda: drag(page, "#parameter-0", 60, 0),  # many values: one step
        lambda: page.locator("#kind-isovalue").click(),
        lambda: drag(page, "#stage", 50, 20),
    ):
        page.wait_for_timeout(1100)  # a gesture of its own
        operate()
        addressed(page)
        requests.append(request_of(page))
    back = [lambda: undo.click(), lambda: page.locator("#stage").press("Control+z"), lambda: page.go_back()]
    for number, step in zip((2, 1, 0), back, strict=True):
        step()
        assert_shown(page, surrogate)
        assert request_of(page) == requests[number]
    assert undo.is_disabled()
    forward = [lambda: redo.click(), lambda: page.locator("#stage").press("Control+Shift+z"), lambda: page.go_forward()]
    for number, step in zip((1, 2, 3), forward, strict=True):
        step()
        assert_shown(page, surrogate)
        assert request_of(page) == requests[number]
    assert redo.is_disabled()
    assert "/ws" not in page.url  # the page was never left


def test_keys_in_an_input_undo_what_is_typed_there(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    drag(page, "#parameter-0", 60, 0)
    addressed(page)
    before = request_of(page)
    page.get_by_label("p, exact value").press("Control+z")
    assert_shown(page, surrogate)
    assert request_of(page) == before
