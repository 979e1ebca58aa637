"""Pins in saved pictures: the same marks and words by the page and by the program, kept in the file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.files.images import read_image
from surrogate.explore.exporting.annotations import Annotations
from surrogate.explore.exporting.commands import export
from surrogate.explore.exporting.exports import from_message
from surrogate.explore.exporting.marks import annotations_of
from surrogate.explore.probing import value_words
from surrogate.explore.request import frame_request
from surrogate.explore.run import Run
from surrogate.storage.picture_records import record_of
from tests.support.drawn_pages import opened
from tests.support.explored import open_explorer, request_of, saved
from tests.support.requests import message

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

PINS = [[0.4, 0.5, 0.6], [0.5, 0.5, 0.5], [90.0, 0.0, 0.0]]
LINK = "a.p.p=0.3&pins=" + ";".join(",".join(map(str, pin)) for pin in PINS)
KNOWN = "() => window.explorer.probe.values()"
MARKS = """async size => {
  const { annotationsOf, scaleOf } = await import(new URL("explore/annotations.js", document.baseURI));
  const { camera } = window.explorer.request(false), pins = window.explorer.probe.marked();
  const { box } = window.explorer.facts;
  return annotationsOf({ camera, size, shown: [], words: "", box, pins, scale: scaleOf(size) });
}"""
WORDS = """async cases => {
  const { shortOf } = await import(new URL("explore/probe.js", document.baseURI));
  return cases.map(([value, deviation, unit]) => shortOf({ value, deviation }, unit));
}"""
CASES = [
    (3.14159, 0.0271, ""),
    (-1.44, 4.4, "m/s"),
    (5.2, 18.3, "K"),
    (-123456.7, 180.0, "kg m-3"),
    (2e8, 3e5, ""),
    (1.2e-12, 3.4e-14, ""),
    (0.0, 0.5, ""),
    (0.57784, 8.4e-5, "kg/m³"),
    (2.0, 0.0, ""),
]


def test_marks_and_words_are_the_programs(page: Page, two: str, two_run: Run) -> None:
    open_explorer(page, two, LINK)
    page.wait_for_function(KNOWN)
    size = [640, 480]
    request = frame_request({**request_of(page), "size": size}, two_run.surrogate)
    said = annotations_of(two_run, request.settings[0], (), PINS)
    assert said.pins[2][1] == "no value"
    expected, found = said.marks(request.camera), page.evaluate(MARKS, size)
    assert [mark[0] for mark in expected] == ["path", "text", "text"] * 2  # the third lies beside the picture
    for own, twin in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.ravel(own[1]), np.ravel(twin[1]), atol=1e-6)
        assert own[2:] == list(twin[2:])
    drawn, _ = request.camera.project(np.array(PINS[:2]))
    np.testing.assert_allclose([mark[1] for mark in expected if mark[0] == "text" and mark[5] == 700], drawn, atol=1e-9)
    words = [value_words({"value": value, "deviation": deviation}, unit) for value, deviation, unit in CASES]
    assert page.evaluate(WORDS, CASES) == words
    assert words[:2] == ["3.142 ± 0.027", "−1.4 ± 4.4 m/s"]


def test_files_have_pins_and_are_drawn_again(page: Page, two: str, two_run: Run, tmp_path: Path) -> None:
    open_explorer(page, two, LINK + "&hide=title,legend,box,axes")
    page.wait_for_function(KNOWN)
    path = saved(page, "png", tmp_path)
    assert record_of(path)["pins"] == PINS
    assert two_run.folder is not None
    pictures: dict[str, Any] = {"saved": read_image(path)}
    for name, more in {"again": [], "elsewhere": ["-p", "p=0.9"]}.items():
        arguments = [str(two_run.folder), "--like", str(path), *more, "-o", str(tmp_path / f"{name}.png")]
        done = CliRunner().invoke(export, arguments)
        assert done.exit_code == 0, done.output
        pictures[name] = read_image(tmp_path / f"{name}.png")
    np.testing.assert_array_equal(pictures["saved"], pictures["again"])
    plain = Annotations("", "", np.zeros((2, 3)), None, ())
    assert plain.marks(frame_request(request_of(page), two_run.surrogate).camera) == []
    page.goto("about:blank")
    open_explorer(page, two, "a.p.p=0.3&hide=title,legend,box,axes")
    bare = read_image(saved(page, "png", tmp_path / "bare"))
    assert 1e-4 < (np.abs(bare - pictures["saved"]) > 0.1).any(axis=2).mean() < 0.05


def test_a_page_alone_saves_them_too(page: Page, two_run: Run, tmp_path: Path) -> None:
    opened(page, two_run.surrogate, tmp_path, modes=12)
    pictures = []
    for link in ("hide=title,legend,box,axes", "hide=title,legend,box,axes&pins=0.4,0.5,0.6"):
        page.evaluate("address => { location.hash = address; }", link)
        page.wait_for_function(
            "count => window.explorer.resting && window.explorer.state.pins.length === count", arg=len(pictures)
        )
        page.wait_for_function("() => !window.explorer.state.pins.length || window.explorer.probe.values()")
        pictures.append(read_image(saved(page, "png", tmp_path / str(len(pictures)))))
    assert 1e-4 < (np.abs(pictures[0] - pictures[1]) > 0.1).any(axis=2).mean() < 0.05


@pytest.mark.parametrize(
    "pins", [3, "abc", [3], [[1, 2]], [{"place": [1, 2]}], [[0, 0, 0]] * 21], ids=lambda pins: str(pins)[:20]
)
def test_wrong_pins_get_a_sentence(two_run: Run, pins: Any) -> None:
    wrong = message(
        settings=[{"parameters": {"p": 0.5, "q": 5.0}}], kind="png", annotations={"shown": [], "pins": pins}
    )
    with pytest.raises(ValueError, match=r"^pins must be a list of"):
        from_message(wrong, two_run)
