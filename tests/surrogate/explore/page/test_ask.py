"""Questions about a picture are answered over it, and never of another picture."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from surrogate import Surrogate
from surrogate.answers.doubt import Doubt
from surrogate.answers.maps import error_map
from surrogate.answers.sensitivity import sensitivity
from surrogate.explore.request import frame_request
from surrogate.explore.run import Run
from surrogate.explore.server.questions import SMALLER
from tests.support.browsers import serious_findings
from tests.support.explored import open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

ANSWERED = "() => { const map = document.querySelector('canvas.over'); return map && !map.hidden; }"


def opacity(page: Page) -> np.ndarray:
    """The opacity (H, W) of the map over the picture."""
    page.wait_for_function(ANSWERED, timeout=60_000)
    data = page.evaluate("document.querySelector('canvas.over').toDataURL()")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data.split(",")[1]))))[..., 3] / 255.0


def test_where_a_parameter_acts(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    page.locator("#over").select_option("p")
    found = opacity(page)
    request = frame_request(request_of(page), surrogate)
    camera = request.camera.resized(request.camera.width // SMALLER, request.camera.height // SMALLER)
    maps = sensitivity(surrogate, request.settings[0].values, camera, background=request.background).magnitudes[0]
    assert found.shape == maps.shape
    assert np.corrcoef(found.ravel(), np.sqrt(maps).ravel())[0, 1] > 0.95
    assert "change of a colour over the range of p" in page.locator("section[aria-label=Ask]").inner_text()
    page.locator("#parameter-0").press("ArrowRight")  # the next answer is of the next picture
    settled(page)
    assert np.abs(opacity(page) - found).max() > 0
    page.locator("#over").select_option("")
    settled(page)
    assert not page.evaluate(ANSWERED)


def test_where_it_may_be_wrong(page: Page, explorer: str, surrogate: Surrogate, run_folder: Path) -> None:
    open_explorer(page, explorer)
    page.wait_for_function("() => document.getElementById('expected').textContent.includes('dB')", timeout=60_000)
    page.locator("#over").select_option("error")
    found = opacity(page)
    run = Run.open(run_folder)
    assert run.catalog is not None
    request = frame_request(request_of(page), surrogate)
    camera = request.camera.resized(request.camera.width // SMALLER, request.camera.height // SMALLER)
    errors = error_map(Doubt.of(run.surrogate, run.catalog), request.settings[0].values, camera)
    assert np.corrcoef(found.ravel(), np.sqrt(errors).ravel())[0, 1] > 0.95
    assert not serious_findings(page)


def test_what_to_simulate_next(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    page.wait_for_function("() => document.querySelector('.runs .expectation')", timeout=60_000)
    page.locator("#suggest").click()
    page.wait_for_function("() => document.querySelectorAll('.runs .suggested').length === 8", timeout=60_000)
    assert "8 runs that would teach most" in page.locator("section[aria-label=Ask]").inner_text()


def test_a_sweep_has_no_map(page: Page, explorer: str) -> None:
    open_explorer(page, explorer, "mode=sweep&over=p")
    page.wait_for_function(
        "() => document.querySelector('section[aria-label=Ask]').textContent.includes('picture of Explore')"
    )
    assert not page.evaluate(ANSWERED)
