"""The explorer's page, beside the API's images for the same settings."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from surrogate import Surrogate
from surrogate.explore.request import frame_request
from tests.support.browsers import PATIENCE

if TYPE_CHECKING:
    from playwright.sync_api import Page

TRIES = 100
AT_REST = """async patience => {
  const until = performance.now() + patience, frame = () => new Promise(requestAnimationFrame);
  const { facts } = await import(new URL("explore/connection.js", document.baseURI));
  for (;;) {
    await frame();
    await frame(); // sizes that changed are told of before the second
    await facts(); // answers come in order: calls that were made before have theirs
    if (window.explorer.resting && window.explorer.counted.whole > 0) return;
    if (performance.now() > until) throw new Error("the page does not come to rest");
  }
}"""
GO = """address => new Promise(gone => {
  window.addEventListener("hashchange", gone, { once: true }); // behind the page's own
  location.hash = address;
})"""


def settled(page: Page) -> None:
    """Wait until the page rests and shows a whole frame."""
    page.wait_for_function("() => window.explorer", timeout=PATIENCE)
    page.evaluate(AT_REST, PATIENCE)


def addressed(page: Page) -> None:
    """Wait until the address says what the page shows."""
    settled(page)
    page.wait_for_function("() => !window.explorer.addressing && location.hash === window.explorer.written")


def go(page: Page, address: str) -> None:
    """Follow a link within the page."""
    page.evaluate(GO, address)


def open_explorer(page: Page, address: str, state: str = "", *, full: int = 256) -> None:
    """Go there, wait for the first whole frame, and unfold all groups of controls.

    Pictures at rest have about `full`² pixels, as what is drawn and compared here takes time; 0: as many as the page chooses.
    """
    size = [f"full={full}"] if full and "full=" not in state else []
    page.goto(f"{address}#{'&'.join([*size, *filter(None, [state])])}")
    settled(page)
    unfold(page)


def unfold(page: Page) -> None:
    """Open all groups of controls, which stay open."""
    page.evaluate("document.querySelectorAll('.group:not(.drawer)').forEach(group => { group.open = true; })")
    page.wait_for_function("() => document.querySelectorAll('.group').length")


def request_of(page: Page) -> dict[str, Any]:
    """The message for what the page now shows at rest."""
    found: dict[str, Any] = page.evaluate("JSON.parse(JSON.stringify(window.explorer.request(false)))")
    return found


def shown(page: Page, number: int = 0) -> NDArray[np.float32]:
    """The pixels of a canvas, (H, W, 3) in [0, 1]."""
    data = page.evaluate("i => document.querySelectorAll('#stage canvas')[i].toDataURL('image/png')", number)
    picture = Image.open(io.BytesIO(base64.b64decode(data.split(",")[1]))).convert("RGB")
    return np.asarray(picture, dtype=np.float32) / 255.0


def drawn(page: Page, surrogate: Surrogate, number: int = 0) -> NDArray[np.float32]:
    """The API's image for the page's settings, (H, W, 3) in [0, 1]."""
    request = frame_request(request_of(page), surrogate)
    deformed = request.settings[number].member(surrogate)
    return deformed.render(request.camera, background=request.background)[..., :3]


def assert_shown(page: Page, surrogate: Surrogate, number: int = 0) -> NDArray[np.float32]:
    """The canvas shows what the API draws, to the rounding of 8 bits; returns it."""
    for _ in range(TRIES):
        settled(page)
        pixels, expected = shown(page, number), drawn(page, surrogate, number)
        if pixels.shape == expected.shape and np.abs(pixels - expected).max() <= 0.51 / 255:
            break
        page.wait_for_timeout(100)  # what was typed may still be on its way to a wish
    assert pixels.shape == expected.shape
    assert np.abs(pixels - expected).max() <= 0.51 / 255
    return pixels


def saved(page: Page, kind: str, folder: Path) -> Path:
    """A file that the page saves."""
    page.locator("#export-kind").select_option(kind)
    with page.expect_download() as coming:
        page.locator("#export").click()
    path = folder / coming.value.suggested_filename
    coming.value.save_as(path)
    return path


def drag(page: Page, selector: str, right: float, down: float, *, key: str = "") -> None:
    """Press the left button in the middle of an element, move, let go; `key` is held meanwhile."""
    element = page.locator(selector)
    element.hover()  # which waits until it is laid out: a pane that was just opened has no size yet
    box = element.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    if key:
        page.keyboard.down(key)
    page.mouse.down()
    for step in range(1, 6):
        page.mouse.move(x + right * step / 5, y + down * step / 5)
    page.mouse.up()
    if key:
        page.keyboard.up(key)
