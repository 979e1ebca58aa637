"""Python sets what an open page shows, and hears of what hands set there."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from surrogate.explore.request import MessageError
from surrogate.explore.run import Run
from surrogate.explore.server.link import PageParameters
from tests.support.explored import assert_shown, open_explorer, request_of

if TYPE_CHECKING:
    from playwright.sync_api import Page


@pytest.mark.slow
def test_python_and_the_page_show_the_same(page: Page, run_folder: Path, surrogate: Surrogate) -> None:
    pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")
    from surrogate.explore.server.notebook import NotebookExplorer

    shown = NotebookExplorer(Run.open(run_folder))
    heard: list[dict[str, float]] = []
    shown.on_change(heard.append)
    try:
        open_explorer(page, shown.address, "a.p.p=0.4")
        until(lambda: shown.parameters["p"] == 0.4)
        shown.parameters["p"] = 0.8
        page.wait_for_function("() => window.explorer.state.settings[0].parameters.p === 0.8")
        assert_shown(page, surrogate)
        assert request_of(page)["settings"][0]["parameters"] == {"p": 0.8}
        page.locator("#parameter-0").press("ArrowRight")
        until(lambda: shown.parameters["p"] == pytest.approx(0.81))
        assert heard == [{"p": 0.4}, {"p": pytest.approx(0.81)}]
    finally:
        page.close()  # before it loses its program
        shown.close()


def until(condition: object) -> None:
    """Wait until a function gives True."""
    assert callable(condition)
    for _ in range(200):
        if condition():
            return
        time.sleep(0.1)
    pytest.fail("it does not become so")


@pytest.fixture
def parameters(surrogate: Surrogate) -> PageParameters:
    return PageParameters(surrogate.space)


def test_a_page_that_has_not_heard_is_told_before_it_is_read(parameters: PageParameters) -> None:
    parameters["p"] = 0.7
    assert parameters.follow({"number": 0, "parameters": {"p": 0.2}}) == {"number": 1, "parameters": {"p": 0.7}}
    assert parameters["p"] == 0.7
    assert parameters.follow({"number": 1, "parameters": {"p": 0.2}}) == {"number": 1, "parameters": None}
    assert dict(parameters) == {"p": 0.2}


def test_a_function_that_fails_harms_nothing(parameters: PageParameters) -> None:
    heard: list[dict[str, float]] = []
    parameters.on_change(lambda _: 1 / 0)
    parameters.on_change(heard.append)
    parameters.follow({"number": 0, "parameters": {"p": 0.2}})
    assert heard == [{"p": 0.2}]


@pytest.mark.parametrize(
    "message", [None, 3, {}, {"parameters": {}}, {"parameters": {"p": "x"}}, {"parameters": {"p": 1e9}}]
)
def test_a_page_says_what_it_shows(parameters: PageParameters, message: object) -> None:
    with pytest.raises(MessageError):
        parameters.follow(message)


def test_what_cannot_be_shown_is_refused(parameters: PageParameters) -> None:
    with pytest.raises(KeyError, match="there is no parameter 'q': p"):
        parameters["q"] = 1.0
    with pytest.raises(ValueError, match="p"):
        parameters["p"] = 99.0
    with pytest.raises(TypeError):
        del parameters["p"]
    assert parameters["p"] == 0.5
