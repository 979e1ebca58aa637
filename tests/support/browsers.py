"""A real browser for tests of pages: the system's Chromium, without a window, driven by Playwright.

`page` is a fresh tab of its own profile.  Its complaints (exceptions, errors in its console: blocked or missing files among
them) fail the test, unless the test takes them out of `complaints`.  `phone` is the same, the size of a phone and
touched.  Under a content security policy `page.wait_for_function` takes functions ("() => ..."), no expressions.  Playwright's
loop runs in the thread of the tests, so tests that need `asyncio` run it in another.
"""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable, Iterator
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, FloatRect, Locator, Page

PROGRAMS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ("--disable-dev-shm-usage", "--disable-gpu", "--force-color-profile=srgb", "--hide-scrollbars")
DESKTOP = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}
PATIENCE = 60_000  # milliseconds: no test fails for being slow


def find_browser() -> str | None:
    """Path of a browser that is installed, or None."""
    return next((path for name in PROGRAMS if (path := shutil.which(name))), None)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """The one browser of a test run; the test skips where there is none."""
    program = find_browser()
    if program is None:
        pytest.skip(f"no browser to test pages with (looked for {', '.join(PROGRAMS)}): `apt-get install chromium`")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        pytest.skip("nothing to drive the browser with: `pip install playwright`")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        yield running
        running.close()


@pytest.fixture
def complaints() -> list[str]:
    """The complaints of a test's pages."""
    return []


def watch(context: BrowserContext, complaints: list[str]) -> None:
    """Collect exceptions and console errors of every page of the context."""

    def hear(message: ConsoleMessage) -> None:
        if message.type == "error":
            complaints.append(f"{message.text} ({message.location.get('url', '')})")

    context.on("console", hear)
    context.on("weberror", lambda failure: complaints.append(str(failure.error)))


NewPage = Callable[..., "Page"]


@pytest.fixture
def new_page(browser: Browser, complaints: list[str]) -> Iterator[NewPage]:
    """Open a tab in a profile of its own: `new_page(viewport=..., has_touch=...)`."""
    contexts = []

    def make(**options: Any) -> Page:
        context = browser.new_context(
            **{"viewport": DESKTOP, "reduced_motion": "reduce", "color_scheme": "dark", **options}
        )
        contexts.append(context)
        context.set_default_timeout(PATIENCE)
        watch(context, complaints)
        return context.new_page()

    yield make
    for context in contexts:
        context.close()
    assert complaints == []


@pytest.fixture
def page(new_page: NewPage) -> Page:
    """A tab of 1280x800."""
    return new_page()


@pytest.fixture
def phone(new_page: NewPage) -> Page:
    """A tab of 390x844 that is touched."""
    return new_page(viewport=PHONE, has_touch=True, is_mobile=True)


def pixels(element: Locator) -> NDArray[np.uint8]:
    """The screen's pixels of an element, [H, W, 3] uint8; it is scrolled to first."""
    element.scroll_into_view_if_needed()
    box = element.bounding_box()
    assert box is not None, "the element is not on the screen"
    # Browsers draw pictures on whole pixels wherever the layout puts them.
    clip: FloatRect = {side: float(round(box[side])) for side in ("x", "y", "width", "height")}  # type: ignore[literal-required, assignment]
    # Hiding the caret would put a style element into the page, which content security policies refuse.
    screen = element.page.screenshot(clip=clip, caret="initial")
    return np.asarray(Image.open(io.BytesIO(screen)).convert("RGB"))


def serious_findings(page: Page) -> list[str]:
    """Serious and critical accessibility violations by axe-core: "rule: help (element)"."""
    script = files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
    # By the debugger, not as an element of the page, whose content security policy would refuse it.
    page.evaluate(script)
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [
        f"{violation['id']}: {violation['help']} ({node['target'][0]})"
        for violation in found["violations"]
        if violation["impact"] in ("serious", "critical")
        for node in violation["nodes"]
    ]
