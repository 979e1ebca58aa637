"""Screenshots for the README and docs: the explorer and the catalog's page in a browser.

    python -m research.benchmarks.explorer.screenshots [--runs runs]

Writes explorer*.png and browse.png in docs/pictures/ from the runs tgv-tf, cloverleaf
and tgv-iso, which must be trained.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from playwright.sync_api import Browser, Page, sync_playwright

from research.benchmarks.explorer.explore import serving
from research.benchmarks.page import PICTURES, command_line
from tests.support.browsers import FLAGS, find_browser

SIZE = {"width": 1280, "height": 800}
STILL = "() => window.explorer?.resting && /dB|Beside/.test(expected.textContent) && !/Measuring/.test(document.body.innerText)"
DARK: dict[str, Any] = {"viewport": SIZE, "color_scheme": "dark"}


def taken(browser: Browser, address: str, state: dict[str, object], wait: str, target: Path) -> None:
    """A screenshot of the page at `address` in a state, once `wait` is true there."""
    page = browser.new_page(**DARK)
    page.goto(f"{address}#{urlencode(state)}")
    page.wait_for_function(wait, timeout=240_000)
    page.wait_for_timeout(500)
    page.screenshot(path=target)
    print(target)
    page.close()


def explored(browser: Browser, runs: Path) -> None:
    """Screenshots of the explorer's three modes."""
    curve = {"a.function": "-20,0;2,0;5,0.1;8,0.7;20,0.9;60,1|", "a.p.Re": 1830}
    with serving("surrogate", "explore", runs / "tgv-tf") as (address, _, _):
        taken(browser, address, curve, STILL, PICTURES / "explorer.png")
    with serving("surrogate", "explore", runs / "cloverleaf") as (address, _, _):
        page: Page = browser.new_page(**DARK)
        page.goto(f"{address}#mode=compare&against=truth")
        page.wait_for_function(STILL, timeout=240_000)
        test = page.locator("#member optgroup[label=test] option").first.get_attribute("value")
        page.locator("#member").select_option(test)
        page.locator("#nearest-picture").click()
        page.wait_for_function("() => document.getElementById('compared').textContent.includes('PSNR')")
        page.wait_for_function(STILL)
        page.screenshot(path=PICTURES / "explorer_compare.png")
        print(PICTURES / "explorer_compare.png")
        page.close()
    swept = {"mode": "sweep", "a.show": "isovalue", "sweep.name": "Re", "sweep.second": "isovalue", "sweep.count": 5}
    with serving("surrogate", "explore", runs / "tgv-iso") as (address, _, _):
        taken(browser, address, swept, STILL, PICTURES / "explorer_sweep.png")


def browsed(browser: Browser, runs: Path) -> None:
    """A screenshot of the catalog's page, with a brush on its parallel coordinates."""
    with serving("catalogs", "browse", runs / "cloverleaf" / "catalog.cdb") as (address, _, _):
        page = browser.new_page(**DARK)
        page.goto(address)
        page.get_by_role("tab", name="Grid").click()
        page.wait_for_timeout(2000)
        page.screenshot(path=PICTURES / "browse.png")
        print(PICTURES / "browse.png")
        page.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Take all pictures."""
    parser = command_line("explorer.screenshots", __doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    given = parser.parse_args(arguments)
    program = find_browser()
    if program is None:
        raise SystemExit("no browser: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        explored(browser, given.runs)
        browsed(browser, given.runs)
        browser.close()


if __name__ == "__main__":
    main()
