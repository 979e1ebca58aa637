"""What the explorer's page shows, beside what the API draws for the same wish."""

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

if TYPE_CHECKING:
    from playwright.sync_api import Page

AT_REST = "() => window.explorer?.stream.resting && window.explorer.counted.whole > 0"


def settled(page: Page) -> None:
    """Wait until the page rests and shows a whole frame."""
    page.wait_for_timeout(80)  # longer than a change takes to become a wish
    page.wait_for_function(AT_REST)


def open_explorer(page: Page, address: str, state: str = "") -> None:
    """Go there and wait for the first whole frame."""
    page.goto(f"{address}#{state}")
    settled(page)


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
    """What the API draws for the page's wish, (H, W, 3) in [0, 1]."""
    request = frame_request(request_of(page), surrogate)
    deformed = request.settings[number].gaussians(surrogate)
    return deformed.render(request.camera, background=request.background)[..., :3]


def assert_shown(page: Page, surrogate: Surrogate, number: int = 0) -> NDArray[np.float32]:
    """The canvas shows what the API draws, to the rounding of 8 bits; returns it."""
    settled(page)
    pixels, expected = shown(page, number), drawn(page, surrogate, number)
    assert pixels.shape == expected.shape
    assert np.abs(pixels - expected).max() <= 0.51 / 255
    return pixels


def saved(page: Page, kind: str, folder: Path) -> Path:
    """What the page saves, as a file."""
    page.locator("#export-kind").select_option(kind)
    with page.expect_download() as coming:
        page.locator("#export").click()
    path = folder / coming.value.suggested_filename
    coming.value.save_as(path)
    return path
