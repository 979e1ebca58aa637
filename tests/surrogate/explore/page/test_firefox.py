"""A page without a program opens from a file in Firefox, and its controls work."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import pytest

from surrogate import Surrogate
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run
from tests.support.firefox import firefox

pytestmark = pytest.mark.slow

T = TypeVar("T")

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


READ = """(() => {
  const canvas = document.querySelector("#stage canvas"), box = canvas.getBoundingClientRect(), bubbles = true;
  const place = { clientX: box.left + 0.46 * box.width, clientY: box.top + 0.52 * box.height, bubbles };
  if (!window.explorer.state.probe) window.dispatchEvent(new KeyboardEvent("keydown", { key: "v" }));
  canvas.dispatchEvent(new PointerEvent("pointermove", place));
  canvas.dispatchEvent(new MouseEvent("click", { ...place, detail: 1 }));
  document.querySelector(".drawer").open = true;
})()"""
PINNED = "window.explorer.probe.values()?.pins[0].length === 1 && !document.getElementById('reading').hidden"
PREDICTED = "!document.querySelector('.tools-of-predictions').hidden"


async def measure(address: str, profile: Path) -> tuple[Any, Any, list[str]]:
    """The value at a pin, what is said of predictions, and the browser's complaints."""
    async with firefox(profile) as page:
        await page.open(address)
        await page.until(RESTS)
        await page.value(READ)
        await page.until(PINNED)
        await page.until(PREDICTED)
        pin = await page.value(
            "JSON.stringify([window.explorer.state.pins[0], window.explorer.probe.values().pins[0][0].value])"
        )
        return pin, await page.value("document.querySelector('.predictions .said').textContent"), page.complaints


def in_thread(work: Coroutine[Any, Any, T]) -> T:
    """Do some work in another thread, for Playwright's loop may run in this one; returns what it gives."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()


def test_firefox_draws_a_page_from_a_file(surrogate: Surrogate, tmp_path: Path) -> None:
    (tmp_path / "page.html").write_bytes(page_bytes(Run("blobs", surrogate)))
    profile = tmp_path / "profile"
    profile.mkdir()
    before, after, complaints = in_thread(look((tmp_path / "page.html").as_uri(), profile))
    assert before != after
    assert complaints == []


def test_firefox_reads_values_and_predicts(two_run: Run, tmp_path: Path) -> None:
    (tmp_path / "page.html").write_bytes(page_bytes(two_run, None, 12))
    profile = tmp_path / "profile"
    profile.mkdir()
    pin, said, complaints = in_thread(measure((tmp_path / "page.html").as_uri(), profile))
    place, value = json.loads(pin)
    assert two_run.surrogate.field is not None
    sampled = two_run.surrogate.field.fields({"p": 0.5, "q": 10.0})[0].sample([place])
    assert value == pytest.approx(sampled.values[0], abs=2e-3)
    assert said.startswith("500 predictions.")
    assert complaints == []
