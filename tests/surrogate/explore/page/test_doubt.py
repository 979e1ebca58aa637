"""A page alone says what error to expect, as the program does."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera
from surrogate.answers.doubt import BETWEEN, FAR, LIKE, NEVER
from surrogate.explore.exporting.expectations import Expectations
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run
from surrogate.explore.setting import base_function

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

ASK = """async cases => {
  const { doubt } = await import("draw/local.js"), { covered, newShare } = await import("draw/doubt.js");
  return cases.map(({ point, camera, transfer }) => ({
    numbers: doubt.numbers(Float64Array.from(point), "gaussians"),
    covered: covered(doubt.views, camera),
    share: newShare(doubt.seen, transfer),
  }));
}"""
SAID = "() => document.getElementById('expected').textContent"


@pytest.fixture(scope="module")
def run(run_folder: Path) -> Run:
    return Run.open(run_folder)


@pytest.fixture(scope="module")
def expected(run: Run) -> Expectations:
    return Expectations.of(run, None, lambda *_: None)


@pytest.fixture
def address(run: Run, expected: Expectations, tmp_path: Path) -> str:
    (tmp_path / "page.html").write_bytes(page_bytes(run, expected))
    return (tmp_path / "page.html").as_uri()


def opened(page: Page, address: str, state: str = "") -> str:
    """The words of the page on its first picture."""
    page.goto("about:blank")
    page.goto(f"{address}#{state}")
    page.wait_for_function("() => window.explorer && window.explorer.resting && window.explorer.counted.whole > 0")
    said: str = page.evaluate(SAID)
    return said


def test_numbers_are_those_of_the_program(page: Page, run: Run, expected: Expectations, address: str) -> None:
    doubt, survey, base = expected.doubt, expected.survey, base_function(run.surrogate)
    assert doubt is not None
    assert survey is not None
    assert doubt.views is not None
    assert doubt.seen_values is not None
    assert base is not None
    random, cases, asked = np.random.default_rng(0), [], []
    for _ in range(40):
        point = random.uniform(-1, 1, 1)
        place = random.normal(size=3) * 10 ** random.uniform(0, 1.2)
        camera = Camera.look_at(place, random.normal(size=3) * 0.3, vertical_fov_degrees=32, width=40, height=30)
        points = sorted(random.uniform(base.opacity_points[0][0], base.opacity_points[-1][0], 4))
        transfer = {
            "opacity_points": [[value, float(random.uniform(0, 1))] for value in points],
            "color_points": [list(c) for c in base.color_points],
            "opacity_unit_distance": base.opacity_unit_distance,
        }
        cases.append({"point": point.tolist(), "camera": camera.to_json(), "transfer": transfer})
        function = type(base)(
            base.color_points, tuple(map(tuple, transfer["opacity_points"])), base.opacity_unit_distance
        )  # type: ignore[arg-type]
        asked.append(
            (survey.expected(point, "gaussians"), doubt.views.cover(camera), doubt.seen_values.novelty(function))
        )
    page.goto(address)
    page.wait_for_function("() => window.explorer")
    found: list[dict[str, Any]] = page.evaluate(ASK, cases)
    for one, (psnr, covers, novelty) in zip(found, asked, strict=True):
        assert one["numbers"]["psnr"] == pytest.approx(min(psnr, 60.0), abs=1e-3)
        assert one["covered"] == covers
        assert one["share"] == pytest.approx(novelty, abs=1e-9)
    assert len({covers for _, covers, _ in asked}) == 2  # some cameras are covered, others not


@pytest.mark.parametrize(
    ("state", "words", "numbers"),
    [
        ("a.p.p=0.5", LIKE, True),
        ("a.p.p=0.13", BETWEEN, True),
        ("a.p.p=1.3", NEVER, False),
        ("a.p.p=0.5&camera=1,0,0,0,0,1,60,0,0,0,32", NEVER, False),
        ("a.p.p=0.5&a.show=isovalue", LIKE, False),
    ],
)
def test_a_page_says_what_to_expect(page: Page, address: str, state: str, words: str, numbers: bool) -> None:
    said = opened(page, address, state)
    assert said.split(":")[0] in ({words, FAR, BETWEEN} if words == BETWEEN else {words})
    assert ("PSNR" in said) == numbers


def test_a_run_without_its_catalog_says_why_nobody_knows(page: Page, run: Run, tmp_path: Path) -> None:
    alone = Run("alone", run.surrogate)
    (tmp_path / "alone.html").write_bytes(page_bytes(alone, Expectations.of(alone, None, lambda *_: None)))
    assert "without its catalog nobody can say" in opened(page, (tmp_path / "alone.html").as_uri())
