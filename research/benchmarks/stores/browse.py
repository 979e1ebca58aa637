"""Latency of the catalog browser, in headless Chromium, over catalogs of tiny images.

`python -m research.benchmarks.stores.browse` measures 400 members of 252 views and 100,000 members of one. It prints
the time to write the page, its size, and the time until its first image is on the screen. It also prints the time from
a movement of a brush, of a slider and of the grid to the next frame. Values are medians, with the fastest and the
slowest. Browser and server share the machine's cores.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from catalogs.browse import CatalogServer, page_of
from catalogs.store.catalog import Catalog
from research.benchmarks.page import command_line
from research.benchmarks.timing import MeasuredTime
from tests.support.synthetic import synthetic_catalog

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CASES = {"400 members of 252 views": (400, 252), "100,000 members of one view": (100_000, 1)}

# From an input event to after the frame that shows its effect, in ms.
LISTEN = """
window.frames = [];
for (const kind of ['pointermove', 'input', 'scroll'])
  window.addEventListener(kind, event => {
    const started = performance.now();
    requestAnimationFrame(() => requestAnimationFrame(() => window.frames.push([kind, performance.now() - started])));
  }, true);
window.addEventListener('DOMContentLoaded', () => {
  const stage = document.querySelector('.stage');
  const look = () => {
    if (stage.getAttribute('aria-busy') === 'false' && !window.firstPicture)
      requestAnimationFrame(() => requestAnimationFrame(() => { window.firstPicture = performance.now(); }));
  };
  new MutationObserver(look).observe(stage, {attributes: true});
  look();
});
"""


@contextmanager
def _served(catalog: Catalog, page: bytes) -> Iterator[str]:
    with CatalogServer(catalog.path, page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.address
        server.shutdown()


def _open(browser: Browser, address: str) -> tuple[Page, float]:
    """A fresh tab at the address, and ms until its first image is visible."""
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.add_init_script(LISTEN)
    page.goto(address)
    page.wait_for_function("() => window.firstPicture")
    return page, page.evaluate("window.firstPicture")


def _frames(page: Page, kind: str) -> list[float]:
    page.wait_for_timeout(300)
    times = [ms for each, ms in page.evaluate("window.frames") if each == kind]
    page.evaluate("window.frames.length = 0")
    return times


def _box(page: Page, selector: str, number: int = 0) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of an element, px."""
    box = page.locator(selector).nth(number).bounding_box()
    assert box is not None
    return box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]


def _drag(page: Page, start: tuple[float, float], end: tuple[float, float], moves: int, kind: str) -> list[float]:
    page.mouse.move(*start)
    page.mouse.down()
    page.evaluate("window.frames.length = 0")
    for x, y in np.linspace(start, end, moves + 1)[1:].tolist():
        page.mouse.move(x, y)
        page.wait_for_timeout(30)
    page.mouse.up()
    return _frames(page, kind)


def _brush(page: Page, moves: int) -> list[float]:
    left, top, right, bottom = _box(page, ".axis", 2)
    x = (left + right) / 2
    return _drag(page, (x, bottom - 40), (x, top + 46), moves, "pointermove")


def _slide(page: Page, moves: int) -> list[float]:
    left, top, right, bottom = _box(page, "#parameter-0")
    y = (top + bottom) / 2
    return _drag(page, (left + 10, y), (right - 10, y), moves, "input")


def _scroll(page: Page, moves: int) -> list[float]:
    page.get_by_role("tab", name="Grid").click()
    page.mouse.move(400, 300)
    page.wait_for_timeout(300)
    page.evaluate("window.frames.length = 0")
    for _ in range(moves):
        page.mouse.wheel(0, 700)
        page.wait_for_timeout(60)
    return _frames(page, "scroll")


def measure(browser: Browser, catalog: Catalog, repeats: int = 5) -> dict[str, str]:
    """Measurements of one catalog, by name."""
    started = time.perf_counter()
    page = page_of(catalog).encode()
    said = {"the page": f"written in {time.perf_counter() - started:.1f} s, {len(page) / 1e6:.2f} MB"}
    measurements: dict[str, list[float]] = {}
    with _served(catalog, page) as address:
        for _ in range(repeats):
            tab, first = _open(browser, address)
            tab.wait_for_selector("#plot[aria-busy=false]")
            taken = {
                "first picture, ms": [first],
                "every line drawn, ms": [tab.evaluate("performance.now()")],
                "brush to next frame, ms": _brush(tab, 20),
                "slider to next frame, ms": _slide(tab, 10),
                "scroll of the grid to next frame, ms": _scroll(tab, 10),
            }
            for name, times in taken.items():
                measurements.setdefault(name, []).extend(times)
            tab.context.close()
    return said | {name: str(MeasuredTime.of(times)) for name, times in measurements.items()}


def main() -> None:
    from playwright.sync_api import sync_playwright

    from tests.support.browsers import FLAGS, find_browser

    parser = command_line("stores.browse", __doc__)
    parser.add_argument(
        "--folder", type=Path, help="where the catalogs are made and stay (default: a temporary folder)"
    )
    options = parser.parse_args()
    program = find_browser()
    if program is None:
        raise SystemExit("no Chromium is installed: `apt-get install chromium`")
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as playwright:
        folder = options.folder or Path(temporary)
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        print(f"Chromium {browser.version}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
        for title, (members, views) in CASES.items():
            path = folder / f"{members}x{views}.cdb"
            catalog = Catalog.open(path) if path.exists() else synthetic_catalog(path, members=members, views=views)
            print(title)
            for name, said in measure(browser, catalog).items():
                print(f"  {name:40}{said}")


if __name__ == "__main__":
    main()
