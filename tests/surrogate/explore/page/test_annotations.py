"""Annotations of a picture: shown over the stage, switched off, clicked, and saved as the program would."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from catalogs.vocabulary.cameras import Camera
from surrogate import Surrogate
from surrogate.explore.exporting.annotations import PARTS, Annotations, nice_numbers
from surrogate.explore.exporting.marks import annotations_of
from surrogate.explore.request import frame_request
from surrogate.explore.run import Run
from surrogate.storage.picture_records import record_of
from tests.support.browsers import serious_findings
from tests.support.drawn_pages import opened
from tests.support.explored import addressed, assert_shown, go, open_explorer, request_of, saved, settled
from tests.support.surrogates import some_surrogate

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
MARKS = """async size => {
  const [{ annotationsOf, scaleOf }, { saidOf }, { current }] =
    await Promise.all(["annotations", "overlay", "state"].map(name => import(`/explore/${name}.js`)));
  const { state, facts } = window.explorer, { camera } = window.explorer.request(false);
  return annotationsOf({ ...saidOf(current(state), state, facts), camera, size, scale: scaleOf(size) });
}"""
VIEWS = ["", "camera=0,-1,0,0,0,1,4,0,0,0,32", "camera=0.6,0.64,-0.48,0,0.6,0.8,0.4,0.1,0,0,60", "a.show=isovalue"]


def assert_marked_alike(page: Page, run: Run) -> None:
    """The page has the marks that the program places on its picture."""
    message, size = request_of(page), [700, 500]
    request = frame_request({**message, "size": size}, run.surrogate)
    said = annotations_of(run, request.settings[0], PARTS)
    words = page.evaluate("document.querySelectorAll('.annotations text').length")
    assert words > 5
    other = Annotations(run.title, "", said.box, said.legend).marks(request.camera)

    def without_settings(marks: list[Any]) -> list[Any]:
        return [mark for mark in marks if mark[0] != "text" or mark[3] != 12 or mark[5] == 700]

    found, expected = without_settings(page.evaluate(MARKS, size)), without_settings(other)
    assert len(found) == len(expected)
    for own, twin in zip(found, expected, strict=True):
        assert own[0] == twin[0]
        np.testing.assert_allclose(np.ravel(own[1]), np.ravel(twin[1]), atol=1e-6)
        assert own[2:] == list(twin[2:])


def test_the_page_and_the_program_place_marks_alike(page: Page, explorer: str, run_folder: Path) -> None:
    run = Run.open(run_folder)
    open_explorer(page, explorer)
    for view in VIEWS:
        go(page, f"full=256&{view}")
        settled(page)
        assert_marked_alike(page, run)


BOXES = """async positions => {
  const { annotationsOf } = await import("/explore/annotations.js"), box = [[-1, -1, -1], [1, 1, 1]];
  const camera = position => ({ position, target: [0, 0, 0], up: [0, 0, 1], field: 30 });
  const marks = position => annotationsOf({ camera: camera(position), size: [600, 600], box, shown: ["box"], lines: [] });
  return positions.map(position => marks(position).filter(mark => mark[0] === "text").map(mark => mark[4]));
}"""


def test_numbers_at_a_corner_are_left_out_alike(modules: Page) -> None:
    turns = np.linspace(0.0, 6.0, 16)
    positions = np.stack([6.0 * np.cos(turns), 6.0 * np.sin(turns), np.full(16, 3.6)], axis=1).tolist()
    cube = Annotations("", "", np.array([[-1.0] * 3, [1.0] * 3]), None, ("box",))
    expected = []
    for position in positions:
        camera = Camera.look_at(position, (0, 0, 0), vertical_fov_degrees=30.0, width=600, height=600)
        expected.append([mark[4] for mark in cube.marks(camera) if mark[0] == "text"])
    assert len({tuple(texts) for texts in expected}) > 4
    assert modules.evaluate(BOXES, positions) == expected


LINES = """async cases => {
  const { annotationsOf, scaleOf } = await import("/explore/annotations.js"), { camera } = window.explorer.request(false);
  const marks = (words, size) =>
    annotationsOf({ camera, size, words, title: "a run", shown: ["title"], scale: scaleOf(size) });
  return cases.map(([words, size]) => marks(words, size).map(mark => [mark[1][1], mark[4]]));
}"""


def test_many_settings_are_broken_into_lines_alike(modules: Page) -> None:
    said = [
        ", ".join(f"parameter_{i} = {i / 7:.5g}" for i in range(n)) + " · predicted, not simulated" for n in (1, 6, 40)
    ]
    cases = [(words, [width, 600]) for words in said for width in (200, 390, 800)]
    box = np.array([[0.0] * 3, [1.0] * 3])
    for (words, size), found in zip(cases, modules.evaluate(LINES, cases), strict=True):
        camera = Camera.look_at((3, 0, 0), (0, 0, 0), vertical_fov_degrees=40.0, width=size[0], height=size[1])
        expected = Annotations("a run", words, box, None, ("title",)).marks(camera)
        assert found == [[mark[1][1], mark[4]] for mark in expected]
        assert len(found) <= 6


def test_ticks_far_from_zero_tell_each_other_apart(modules: Page) -> None:
    asked = "async ends => (await import('/explore/annotations.js')).niceNumbers(...ends).texts"
    for ends in ([1e6 - 40.0, 1e6 + 40.0, 4], [-1.0, 1.0, 4], [0.0, 2e-6, 2]):
        texts = modules.evaluate(asked, ends)
        assert texts == nice_numbers(*ends)[1]
        assert len(set(texts)) == len(texts)


def shapes(page: Page) -> int:
    count: int = page.evaluate("document.querySelectorAll('.annotations > g[aria-hidden] > *').length")
    return count


def test_each_part_is_switched_off_and_the_link_says_so(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    counts = [shapes(page)]
    for part in PARTS:
        page.locator(f"#show-{part}").uncheck()
        settled(page)
        counts.append(shapes(page))
    assert counts == sorted(set(counts), reverse=True)
    assert counts[-1] == 0
    addressed(page)
    assert "hide=title%2Clegend%2Cbox%2Caxes" in page.url
    page.reload()
    settled(page)
    assert shapes(page) == 0
    assert not page.locator("#show-box").is_checked()
    page.locator("#show-box").check()
    settled(page)
    assert shapes(page) > 12
    open_explorer(page, explorer, "hide=box,nothing")
    assert "names other parts than title, legend, box, axes" in page.locator("#note").inner_text()


def test_axes_look_along_themselves(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    for axis, way, expected in (
        ("x", "click", [1, 0, 0]),
        ("z", "click", [0, 0, 1]),
        ("z", "click", [0, 0, -1]),
        ("x", "Enter", [1, 0, 0]),
        ("z", "Enter", [0, 0, 1]),
        ("z", "Enter", [0, 0, -1]),
    ):
        target = page.get_by_role("button", name=f"Look along {axis}")
        if way == "click":
            target.click()
        else:
            target.focus()
            page.keyboard.press("Enter")
        assert_shown(page, surrogate)
        assert page.evaluate("window.explorer.state.orbit.direction") == pytest.approx(expected)
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "Look along z"
    assert serious_findings(page) == []


def test_a_saved_picture_has_what_is_seen_and_says_so(page: Page, explorer: str, tmp_path: Path) -> None:
    open_explorer(page, explorer, "hide=legend")
    path = saved(page, "png", tmp_path)
    assert record_of(path)["annotations"] == ["title", "box", "axes"]
    assert saved(page, "exr", tmp_path).stat().st_size > 1000


def test_a_page_alone_saves_the_marks_with_the_picture(page: Page, tmp_path: Path) -> None:
    opened(page, some_surrogate(3, 40), tmp_path)
    pictures: list[Any] = []
    for part in (None, *PARTS):
        if part:
            page.locator(f"#show-{part}").uncheck()
            page.wait_for_function("() => window.explorer.resting")
        with page.expect_download() as coming:
            page.locator("#export").click()
        pictures.append(np.asarray(Image.open(io.BytesIO(Path(coming.value.path()).read_bytes())).convert("RGB")))
    changed = [np.abs(one.astype(int) - pictures[-1]).max(axis=2) > 40 for one in pictures]
    counts = [int(one.sum()) for one in changed]
    assert counts[0] > counts[1] >= counts[2] > counts[3] > counts[4] == 0
