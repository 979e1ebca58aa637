"""The README's moving picture: ten seconds of a run's page, as an animated WebP.

    python -m research.benchmarks.explorer.moving RUN [-o docs/pictures/explorer.webp]

RUN is that of the README's two minutes.  First its last parameter moves over its range, then the camera turns, then an opacity of
the transfer function rises and falls.  Every frame is a screenshot of the page at rest: minutes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from catalogs.files import durable
from research.benchmarks.explorer.explore import serving
from research.benchmarks.page import PICTURES, command_line
from tests.support.browsers import FLAGS, find_browser

SIZE = {"width": 1120, "height": 700}
SHOWN = (800, 500)  # pixels of a frame
RATE, PART = 8, 27  # frames a second, and of each of the three parts
FIRST = "() => document.documentElement.dataset.shown"
STILL = "() => window.explorer?.resting && !/Measuring/.test(document.body.innerText)"
LIFT = 0.5  # of the camera, as a share of its distance from the vertical axis
OPACITY = "0,0;0.05,0;0.5,{:.2f};1,0.8|"


def states(parameter: dict[str, Any], orbit: dict[str, Any]) -> Iterator[dict[str, str]]:
    """The address of each frame; the camera keeps the distance of the page's first."""
    low, high = parameter["low"], parameter["high"]
    for frame in range(3 * PART):
        share = (frame % PART) / (PART - 1)
        part = frame // PART
        along = 0.5 - 0.5 * math.cos(1.6 * math.pi * share) if part == 0 else 0.5 - 0.5 * math.cos(1.6 * math.pi)
        angle = 0.6 + (0.0, 2.0 * math.pi * (3 * share**2 - 2 * share**3), 0.0)[part]
        direction = [math.cos(angle), math.sin(angle), LIFT]
        length = math.hypot(*direction)
        camera = [*(each / length for each in direction), 0, 0, 1, orbit["distance"], *orbit["target"], orbit["field"]]
        opacity = 0.4 + (0.0, 0.0, 0.4 * math.sin(2.0 * math.pi * share))[part]
        edited = {"a.function": OPACITY.format(opacity)} if part == 2 else {}
        yield edited | {
            f"a.p.{parameter['name']}": f"{low + along * (high - low):.6g}",
            "camera": ",".join(f"{number:.5g}" for number in camera),
        }


def taken(page: Page, address: str) -> list[Image.Image]:
    """The frames of the page at `address`."""
    page.goto(address)
    page.wait_for_function(FIRST, timeout=240_000)
    page.wait_for_function(STILL, timeout=240_000)
    known = page.evaluate("() => [window.explorer.facts.parameters.at(-1), window.explorer.state.orbit]")
    frames = []
    for state in states(*known):
        page.evaluate("hash => { location.hash = hash }", urlencode(state))
        page.wait_for_timeout(60)
        page.wait_for_function(STILL, timeout=240_000)
        picture = Image.open(BytesIO(page.screenshot())).convert("RGB")
        frames.append(picture.resize(SHOWN, Image.Resampling.LANCZOS))
    return frames


def main(arguments: Sequence[str] | None = None) -> None:
    """Take the frames and write the film."""
    parser = command_line("explorer.moving", __doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=PICTURES / "explorer.webp")
    given = parser.parse_args(arguments)
    program = find_browser()
    if program is None:
        raise SystemExit("no browser: apt-get install chromium")
    with sync_playwright() as playwright, serving("surrogate", "explore", given.run) as (address, _, _):
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        first, *others = taken(browser.new_page(viewport=SIZE, color_scheme="dark"), address)
        browser.close()
    film = BytesIO()
    first.save(film, "webp", save_all=True, append_images=others, duration=1000 // RATE, loop=0, quality=60, method=6)
    durable.replace(given.output, film.getvalue())
    print(f"{given.output}: {len(film.getvalue()) / 1e6:.1f} MB, {len(others) + 1} frames")


if __name__ == "__main__":
    main()
