"""A page without a program opens from a file in Firefox, and its controls work."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from surrogate import Surrogate
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run
from tests.support.firefox import firefox

pytestmark = pytest.mark.slow

RESTS = "window.explorer?.resting && window.explorer.counted.whole > 0"
PICTURE = "document.querySelector('#stage canvas').toDataURL()"
SLIDE = """(() => {
  const slider = document.getElementById("parameter-0");
  slider.value = 0.9;
  slider.dispatchEvent(new Event("input"));
})()"""


async def look(address: str, profile: Path) -> tuple[str, str, list[str]]:
    """The picture before and after a parameter is changed, and the browser's complaints."""
    async with firefox(profile) as page:
        await page.open(address)
        await page.until(RESTS)
        before = await page.value(PICTURE)
        await page.value(SLIDE)
        await page.until(f"{RESTS} && {PICTURE} !== {before!r}")
        return before, await page.value(PICTURE), page.complaints


def test_firefox_draws_a_page_from_a_file(surrogate: Surrogate, tmp_path: Path) -> None:
    (tmp_path / "page.html").write_bytes(page_bytes(Run("blobs", surrogate)))
    profile = tmp_path / "profile"
    profile.mkdir()
    results, errors = [], []

    def run() -> None:  # Playwright's loop may run in this thread
        try:
            results.append(asyncio.run(look((tmp_path / "page.html").as_uri(), profile)))
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    if errors:
        raise errors[0]
    ((before, after, complaints),) = results
    assert before != after
    assert complaints == []
