"""Snapshots are seen again, played, and saved as a film and as a session."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from surrogate import Surrogate
from surrogate.explore.request import frame_request
from tests.support.browsers import serious_findings
from tests.support.explored import assert_shown, go, open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

BETWEEN = """async ([first, last, shares]) => {
  const { stateOf } = await import("/explore/address.js"), { stateBetween } = await import("/explore/journey.js");
  const { facts } = window.explorer, [a, b] = [first, last].map(one => stateOf(one, facts).state);
  return shares.map(share => stateBetween(a, b, share, facts));
}"""


def two_snapshots(page: Page, explorer: str) -> list[dict[str, Any]]:
    """Keep two; returns their requests."""
    open_explorer(page, explorer, "a.p.p=0.1&full=256")
    assert page.locator("#play-snapshots").is_disabled()
    requests = [request_of(page)]
    page.locator("#keep").click()
    go(page, "a.p.p=0.9&full=256&camera=0,-1,0,0,0,1,7,0,0,0,32")
    settled(page)
    page.locator("#keep").click()
    return [*requests, request_of(page)]


def test_a_snapshot_is_seen_again(page: Page, explorer: str, surrogate: Surrogate) -> None:
    requests = two_snapshots(page, explorer)
    assert page.locator(".snapshot canvas").count() == 2
    for number in (0, 1):
        page.locator(".snapshot").nth(number).click()
        assert_shown(page, surrogate)
        assert request_of(page)["settings"] == requests[number]["settings"]
        assert request_of(page)["camera"] == requests[number]["camera"]
    assert not serious_findings(page)
    page.get_by_role("button", name="Remove snapshot 1").click()
    assert page.locator(".snapshot").count() == 1
    page.locator("#mode-sweep").click()  # another arrangement
    settled(page)
    assert page.locator(".snapshot canvas").count() == 1


def test_they_are_played_one_after_the_other(page: Page, explorer: str, surrogate: Surrogate) -> None:
    requests = two_snapshots(page, explorer)
    page.locator(".snapshot").first.click()
    settled(page)
    page.locator("#play-snapshots").click()
    page.wait_for_function("() => window.explorer.state.settings[0].parameters.p > 0.3")
    assert page.locator("#play-snapshots").get_attribute("aria-pressed") == "true"
    page.wait_for_function("() => document.getElementById('play-snapshots').getAttribute('aria-pressed') === 'false'")
    assert_shown(page, surrogate)
    last = request_of(page)
    assert last["settings"] == requests[1]["settings"]
    np.testing.assert_allclose(last["camera"]["position"], requests[1]["camera"]["position"], atol=1e-6)


def test_the_way_between_is_even_and_goes_the_shorter_way(modules: Page) -> None:
    ends = ["#a.p.p=0&camera=-1,0.1,0,0,0,1,4,0,0,0,32", "#a.p.p=1&camera=-1,-0.1,0,0,0,1,16,1,0,0,32"]
    first, half, last = modules.evaluate(BETWEEN, [*ends, [0, 0.5, 1]])
    assert [s["settings"][0]["parameters"]["p"] for s in (first, half, last)] == pytest.approx([0, 0.5, 1])
    assert half["orbit"]["distance"] == pytest.approx(8)  # the geometric mean
    assert half["orbit"]["direction"] == pytest.approx([-1, 0, 0], abs=1e-6)
    assert half["orbit"]["target"] == pytest.approx([0.5, 0, 0])


def test_a_film_and_a_session_are_saved(page: Page, explorer: str, surrogate: Surrogate, tmp_path: Path) -> None:
    requests = two_snapshots(page, explorer)
    page.locator("#journey-form").select_option("gif")
    with page.expect_download(timeout=60_000) as coming:
        page.locator("#save-journey").click()
    path = tmp_path / "film.gif"
    coming.value.save_as(path)
    with Image.open(path) as film:
        assert film.n_frames == 49
        for number, request in ((0, requests[0]), (48, requests[1])):
            film.seek(number)
            picture = (
                np.asarray(film.convert("RGB"), dtype=np.float32)[40:-40, 60:] / 255
            )  # without the marks at the edges
            asked = frame_request(request, surrogate)
            camera = asked.camera.resized(film.width, film.height)
            drawn = asked.settings[0].member(surrogate).render(camera, background=asked.background)[40:-40, 60:, :3]
            assert np.median(np.abs(picture - drawn)) < 0.05
    with page.expect_download() as coming:
        page.locator("#save-session").click()
    session = tmp_path / "session.json"
    coming.value.save_as(session)
    assert len(json.loads(session.read_text())) == 2
    page.locator("#open-session").set_input_files(session)
    page.wait_for_function("() => document.querySelectorAll('.snapshot').length === 4")
    wrong = tmp_path / "wrong.json"
    wrong.write_text('["javascript:alert(1)"]')
    page.locator("#open-session").set_input_files(wrong)
    page.wait_for_function("() => document.getElementById('alert').textContent.includes('is not a session')")


def test_they_play_when_a_frame_began_before_the_press(page: Page, explorer: str) -> None:
    two_snapshots(page, explorer)
    page.evaluate("const now = performance.now.bind(performance); performance.now = () => now() + 100;")
    page.locator("#play-snapshots").click()
    page.wait_for_function("() => document.getElementById('play-snapshots').getAttribute('aria-pressed') === 'false'")
    assert request_of(page)["settings"][0]["parameters"]["p"] == pytest.approx(0.9)
