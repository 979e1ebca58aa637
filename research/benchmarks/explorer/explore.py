"""Latency and frame rate of the explorer, measured in a browser.

    python -m research.benchmarks.explorer.explore RUN [--seconds 4] [--interactions 10000] [--write]

Starts `surrogate explore RUN` and opens it in the system's headless Chromium. It moves the mouse over the image, a
slider and, if the model follows one, the transfer function, and counts the frames on the screen. Prints Markdown. The
browser draws on the same processor: nothing else should run.
"""

from __future__ import annotations

import itertools
import math
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil
from playwright.sync_api import Browser, Page, sync_playwright

from research.benchmarks.page import RESULTS, command_line, commit, publish, table
from surrogate.provenance import machine
from tests.support.browsers import FLAGS, find_browser

SESSIONS = 4
SETTLES = 12  # pauses of the mouse
WATCH = """() => {
  window.seen = [];
  window.touched = 0;
  let whole = 0;
  new MutationObserver(() => {
    const [, now] = document.documentElement.dataset.shown.split(" ").map(Number);
    window.seen.push([performance.now(), now > whole]);
    whole = now;
  }).observe(document.documentElement, { attributes: true, attributeFilter: ["data-shown"] });
  for (const kind of ["pointermove", "input"]) document.addEventListener(kind, () => { window.touched = performance.now(); }, true);
}"""


@dataclass(frozen=True)
class FrameRate:
    """Frames per second, and the longest time between two frames in milliseconds."""

    frames: float
    longest: float


@contextmanager
def serving(program: str, command: str, target: Path) -> Iterator[tuple[str, psutil.Process, float]]:
    """A running `surrogate explore` or `catalogs browse`: its address, its process, and its start time."""
    started = time.perf_counter()
    process = subprocess.Popen(
        [str(Path(sys.executable).with_name(program)), command, str(target)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        match = re.search(r"http://\S+", said)
        if match is None:
            raise RuntimeError(f"{program} {command} did not start: {said!r}")
        yield match.group(), psutil.Process(process.pid), started
    finally:
        process.terminate()
        process.wait(timeout=30)


def opened(browser: Browser, address: str) -> Page:
    """A tab in a profile of its own, once it shows an image."""
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.goto(address)
    page.wait_for_function("() => document.documentElement.dataset.shown")
    page.evaluate(WATCH)
    return page


def around(page: Page, selector: str) -> Callable[[float], tuple[float, float]]:
    """A path of the mouse within an element, at any time in seconds."""
    box = page.locator(selector).bounding_box()
    assert box is not None
    x, y, width, height = box["x"], box["y"], box["width"], box["height"]
    if height < 40:  # a slider
        return lambda t: (x + width * (0.5 + 0.35 * math.sin(1.7 * t)), y + height / 2)
    radius = 0.25 * min(width, height)
    return lambda t: (x + width / 2 + radius * math.cos(2 * t), y + height / 2 + radius * math.sin(3 * t))


def rate_of(page: Page, path: Callable[[float], tuple[float, float]], seconds: float) -> FrameRate:
    """Frames shown while the mouse, pressed, follows the path."""
    page.mouse.move(*path(0.0))
    page.mouse.down()
    start = page.evaluate("(window.seen = [], performance.now())")
    begun = time.perf_counter()
    while (t := time.perf_counter() - begun) < seconds:
        page.mouse.move(*path(t))
        time.sleep(0.008)  # a mouse reports some hundred positions a second
    times = [shown for shown, _ in page.evaluate("window.seen") if shown > start]
    page.mouse.up()
    gaps = [later - earlier for earlier, later in itertools.pairwise(times)]
    return FrameRate(len(times) / seconds, max(gaps, default=math.inf))


def rest_times(page: Page, selector: str) -> list[float]:
    """Milliseconds from the last movement to the full frame."""
    times = []
    for number in range(SETTLES):
        path = around(page, selector)
        page.mouse.move(*path(number))
        page.mouse.down()
        for step in range(20):
            page.mouse.move(*path(number + step / 40))
            time.sleep(0.008)
        page.wait_for_timeout(600)
        times.append(page.evaluate("window.seen.find(([t, whole]) => whole && t > window.touched)[0] - window.touched"))
        page.mouse.up()
        page.wait_for_timeout(200)
        page.evaluate("window.seen = []")
    return times


def handles(page: Page) -> dict[str, str]:
    """Draggable elements by what they change."""
    selectors = {"view": "#stage", "simulation parameter": "#parameter-0"}
    for kind, selector in (("isovalue", "#isovalue"), ("transfer_function", ".transfer .handle >> nth=1")):
        if page.locator(f"#kind-{kind}").count() or page.locator(selector).count():
            selectors[kind.replace("_", " ")] = selector
    return selectors


def show(page: Page, name: str) -> None:
    """Scroll the element into view."""
    tab = page.locator(f"#kind-{name.replace(' ', '_')}")
    if tab.count():
        tab.click()
        page.wait_for_timeout(500)


def grown(page: Page, process: psutil.Process, count: int) -> tuple[float, float]:
    """Megabytes of the process after a tenth of `count` interactions, and after all of them."""
    path, early = around(page, "#stage"), 0.0
    page.mouse.move(*path(0.0))
    page.mouse.down()
    for number in range(count):
        page.mouse.move(*path(number / 50))
        if number == count // 10:
            early = process.memory_info().rss / 1e6
    page.mouse.up()
    page.wait_for_timeout(500)
    return early, process.memory_info().rss / 1e6


def seconds_of(process: psutil.Process) -> float:
    """Processor time of a process."""
    times = process.cpu_times()
    return float(times.user + times.system)


def together(browser: Browser, address: str, process: psutil.Process, seconds: float) -> tuple[list[FrameRate], float]:
    """Frame rates of several tabs that are all moved at once, by scripts in their pages.

    Beside them the share of the processors' time that the explorer's `process` has; tabs have the rest.
    """
    pages = [opened(browser, address) for _ in range(SESSIONS)]
    for page in pages:
        page.evaluate("""() => {
          let t = 0;
          window.seen = [];
          window.moving = setInterval(() => {
            t += 1;
            const slider = document.getElementById("parameter-0"), share = 0.5 + 0.3 * Math.sin(t / 30);
            slider.value = +slider.min + share * (slider.max - slider.min);
            slider.dispatchEvent(new Event("input", { bubbles: true }));
          }, 16);
        }""")
    before = seconds_of(process)
    time.sleep(seconds)
    share, rates = (seconds_of(process) - before) / (seconds * (psutil.cpu_count() or 1)), []
    for page in pages:
        times = [t for t, _ in page.evaluate("(clearInterval(window.moving), window.seen)")]
        gaps = [later - earlier for earlier, later in itertools.pairwise(times)]
        rates.append(FrameRate(len(times) / seconds, max(gaps, default=math.inf)))
        page.context.close()
    return rates, share


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = command_line("explorer.explore", __doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each movement")
    parser.add_argument("--interactions", type=int, default=10_000, help="0 leaves the memory unmeasured")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/explorer.md")
    given = parser.parse_args(arguments)
    program = find_browser()
    if program is None:
        raise SystemExit("no browser: apt-get install chromium")
    rows: list[list[str]] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        with serving("surrogate", "explore", given.run) as (address, process, started):
            page = opened(browser, address)
            rows.append(["first picture after the command", f"{time.perf_counter() - started:.1f} s", ""])
            page.wait_for_timeout(12_000)  # expected errors are measured once, beside the first frames
            for name, selector in handles(page).items():
                show(page, name)
                rate = rate_of(page, around(page, selector), given.seconds)
                rest = rest_times(page, selector)
                rows.append([f"moving: {name}", f"{rate.frames:.0f} frames/s", f"longest gap {rate.longest:.0f} ms"])
                rows.append(
                    [
                        f"whole frame after rest: {name}",
                        f"{statistics.median(rest):.0f} ms",
                        f"longest {max(rest):.0f} ms",
                    ]
                )
            rates, share = together(browser, address, process, given.seconds)
            slowest = min(rates, key=lambda r: r.frames)
            said = f"longest gap {max(r.longest for r in rates):.0f} ms; {share:.0%} of the processors' time is the explorer's"
            rows.append([f"{SESSIONS} tabs moved at once, the slowest", f"{slowest.frames:.0f} frames/s", said])
            if given.interactions:
                early, late = grown(page, process, given.interactions)
                words = f"memory after {given.interactions // 10:,} and {given.interactions:,} interactions"
                rows.append([words, f"{early:.0f} and {late:.0f} MB", ""])
        browser.close()
    made = f"`{given.run.name}`; {machine()['processor']}, {psutil.cpu_count()} cores that also ran the browser; commit {commit()}."
    body = f"{table(['what', 'measured', 'at worst'], rows)}\n{made}"
    publish(body, RESULTS / "explorer.md", "speed", write=given.write)


if __name__ == "__main__":
    main()
