"""Values under the pointer and at pins are the emulated field's, by mouse and by keyboard, with a program and without one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from native.ray_casting.cuts import Cut
from surrogate.explore.probing import seen_place, value_words, values_at
from surrogate.explore.request import frame_request
from surrogate.explore.run import Run
from tests.support.browsers import serious_findings
from tests.support.drawn_pages import opened
from tests.support.explored import addressed, go, open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

READ = "() => !document.getElementById('reading').hidden && document.getElementById('reading').innerText"
VALUES = "() => { const known = window.explorer.probe.values(); return known && known.pins[0]; }"


def place_of(page: Page, right: float, down: float) -> tuple[float, float]:
    """The place on the screen of shares of the picture."""
    box = page.locator("#stage canvas").first.bounding_box()
    assert box is not None
    return box["x"] + right * box["width"], box["y"] + down * box["height"]


def expected(run: Run, page: Page) -> tuple[Any, Any]:
    """The place that is seen at the pointer and its value, by the program's own arithmetic."""
    request, field = frame_request(request_of(page), run.surrogate), run.surrogate.field
    assert field is not None
    setting = request.settings[0]
    member = field.member(field.point(setting.values, "allow")).cut_to(setting.cut or Cut())
    place = seen_place(member, request.camera, page.evaluate("window.explorer.probe.at.pixel"))
    assert place is not None
    return place, values_at(member.field(), [place])[0]


def test_the_pointer_reads_values_and_a_press_pins_them(page: Page, two: str, two_run: Run) -> None:
    open_explorer(page, two, "a.p.p=0.3")
    page.locator("#toggle-probe").click()
    page.mouse.move(*place_of(page, 0.46, 0.52))
    page.wait_for_function(READ)
    place, value = expected(two_run, page)
    first, interval, where = page.locator("#reading").inner_text().splitlines()
    shown, deviation = (float(part.replace("−", "-")) for part in first.split(" ± "))
    assert shown == pytest.approx(value["value"], abs=value["deviation"] / 10 + 1e-6)
    assert deviation == pytest.approx(value["deviation"], rel=0.05)
    low, high = (float(part.replace("−", "-")) for part in interval.removeprefix("90 %: ").split(" to "))
    assert (low, high) == pytest.approx(
        (value["value"] - value["half"], value["value"] + value["half"]), abs=value["half"] / 20
    )
    assert [float(part[2:].replace("−", "-")) for part in where.split("  ")] == pytest.approx(place, abs=2e-3)
    page.mouse.click(*place_of(page, 0.46, 0.52))
    page.wait_for_function(VALUES)
    pin = page.evaluate("window.explorer.state.pins[0]")
    assert pin == pytest.approx(place, abs=2e-2)  # to a pixel
    assert two_run.surrogate.field is not None
    sampled = two_run.surrogate.field.fields({"p": 0.3, "q": 10.0})[0].sample([pin])
    assert page.evaluate(VALUES)[0]["value"] == pytest.approx(sampled.values[0])
    page.mouse.move(*place_of(page, 0.02, 0.98))
    page.wait_for_function("() => document.getElementById('reading').innerText === 'Nothing is seen here'")
    assert not serious_findings(page)


def test_pins_follow_the_camera_and_the_parameters_and_stay_in_the_link(page: Page, two: str, two_run: Run) -> None:
    open_explorer(page, two, "a.p.p=0.3&probe=on&pins=0.4,0.5,0.6;0.5,0.5,0.5")
    page.wait_for_function(VALUES)
    before = page.evaluate(VALUES)
    assert two_run.surrogate.field is not None
    field = two_run.surrogate.field.fields({"p": 0.3, "q": 10.0})[0]
    assert [one["value"] for one in before] == pytest.approx(field.sample([[0.4, 0.5, 0.6], [0.5] * 3]).values)
    page.locator("#parameter-0").press("PageUp")
    settled(page)
    page.wait_for_function(VALUES)
    assert page.evaluate(VALUES)[0]["value"] != before[0]["value"]
    marks = page.locator("#stage circle.pin")
    places = [marks.nth(i).get_attribute("cx") for i in range(2)]
    page.locator("#stage").press("ArrowRight")
    settled(page)
    assert [marks.nth(i).get_attribute("cx") for i in range(2)] != places
    addressed(page)
    assert "pins=0.4%2C0.5%2C0.6%3B0.5%2C0.5%2C0.5" in page.evaluate("location.hash")
    page.get_by_label("Remove pin 1").click()
    assert page.evaluate("window.explorer.state.pins") == [[0.5, 0.5, 0.5]]
    addressed(page)
    page.locator("#steps button, .steps button").first.click()  # undone
    settled(page)
    assert len(page.evaluate("window.explorer.state.pins")) == 2


def test_a_comparison_has_values_of_both(page: Page, two: str, two_run: Run) -> None:
    open_explorer(page, two, "mode=compare&a.p.p=0.3&b.p.p=0.8&probe=on&pins=0.4,0.5,0.6")
    page.wait_for_function(VALUES)
    assert two_run.surrogate.field is not None
    for which, p in enumerate((0.3, 0.8)):
        sampled = two_run.surrogate.field.fields({"p": p, "q": 10.0})[0].sample([[0.4, 0.5, 0.6]])
        words = value_words({"value": sampled.values[0], "deviation": sampled.deviations[0]}, "")
        assert page.locator("#stage .pane").nth(which).locator(".pin-value").text_content() == words
        assert f"{'AB'[which]}: {words}" in page.locator(".pins").inner_text()
    box = page.locator("#stage canvas").nth(1).bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.48 * box["width"], box["y"] + 0.52 * box["height"])
    page.wait_for_function(READ)
    assert page.evaluate("window.explorer.probe.at.pane") == 1


NEWEST = """async () => {
  const { Newest } = await import(new URL("explore/newest.js", document.baseURI)), asked = [], taken = [], failed = [];
  const free = [], ask = question => new Promise((take, refuse) => { asked.push(question); free.push({ take, refuse }); });
  const newest = new Newest(ask, (answer, question) => taken.push([answer, question]), (error, question) => failed.push(question));
  const soon = () => new Promise(resolve => { setTimeout(resolve); });
  for (const question of ["first", "second", "third", "fourth"]) newest.wish(question);
  const before = [...asked];
  free[0].take("one");
  await soon();
  newest.wish("fifth");
  newest.drop();
  free[1].refuse(new Error("no"));
  await soon();
  newest.wish("sixth");
  free[2].take("six");
  await soon();
  return { before, asked, taken, failed };
}"""


def test_one_question_is_asked_at_a_time_and_the_newest_next(modules: Page) -> None:
    found = modules.evaluate(NEWEST)
    assert found["before"] == ["first"]
    assert found["asked"] == ["first", "fourth", "sixth"]
    assert found["taken"] == [["one", "first"], ["six", "sixth"]]
    assert found["failed"] == ["fourth"]


def test_keys_read_and_pin_the_middle(page: Page, two: str) -> None:
    open_explorer(page, two)
    page.locator("#show-keys").focus()  # the keyboard's focus, as people reach the stage
    page.keyboard.press("v")
    page.locator("#stage").focus()
    page.keyboard.press("Enter")
    page.wait_for_function("() => window.explorer.state.pins.length === 1")
    page.wait_for_function(READ)
    page.locator("#cross").wait_for(state="visible")
    page.keyboard.press("v")
    page.locator("#reading").wait_for(state="hidden")
    page.get_by_label("Remove pin 1").press("Enter")
    page.wait_for_function("() => window.explorer.state.pins.length === 0")


NO_PINS = ("1,2", "1,2,x", "1,2,3;", "1,2,Infinity", ";".join(["1,2,3"] * 21))


def test_pins_that_are_none_are_named(page: Page, two: str) -> None:
    open_explorer(page, two)
    for pins in NO_PINS:
        go(page, "")
        assert page.locator("#note").is_hidden()
        go(page, f"pins={pins}")
        assert "pins" in page.locator("#note").inner_text(), pins
        assert page.evaluate("window.explorer.state.pins") == [], pins


def test_a_run_without_a_field_says_so(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    page.keyboard.press("v")
    page.mouse.move(*place_of(page, 0.5, 0.5))
    page.wait_for_function(
        "() => document.querySelector('section[aria-label=Probe]').innerText.includes('no emulated field')"
    )


def test_a_page_alone_reads_its_field(page: Page, two_run: Run, tmp_path: Path) -> None:
    opened(page, two_run.surrogate, tmp_path, modes=12)
    page.keyboard.press("v")
    for right, cut in ((0.46, ""), (0.47, "a.slice=x,0.5"), (0.48, "a.clip=0.2,0.6,0,0.9,1,1")):
        go(page, f"full=256&probe=on&{cut}")
        page.wait_for_function("() => window.explorer.resting")
        page.mouse.move(*place_of(page, right, 0.98))
        page.wait_for_function("() => document.getElementById('reading').innerText === 'Nothing is seen here'")
        page.mouse.move(*place_of(page, right, 0.52))
        page.wait_for_function("() => document.getElementById('reading').innerText.includes('not known')")
        place, value = expected(two_run, page)
        first, unknown, where = page.locator("#reading").inner_text().splitlines()
        assert float(first.replace("−", "-")) == pytest.approx(value["value"], abs=2e-3)
        assert unknown == "error not known here"
        assert [float(part[2:].replace("−", "-")) for part in where.split("  ")] == pytest.approx(place, abs=5e-3)


def test_a_histogram_of_what_is_shown_lies_over_that_of_all_runs(page: Page, two: str, two_run: Run) -> None:
    open_explorer(page, two, "a.p.p=0.3")
    page.wait_for_function("() => window.explorer.here.found")
    assert two_run.surrogate.field is not None
    values = two_run.surrogate.field.fields({"p": 0.3, "q": 10.0})[0].values
    histogram = page.evaluate("window.explorer.facts.histogram")
    counts = np.histogram(values, histogram["edges"])[0] * histogram["samples"] / values.size
    heights = np.log1p(counts) / np.log1p(histogram["most"])
    path = page.locator("path.here").get_attribute("d")
    assert path is not None
    drawn = [float(part.split(" ")[1].split("H")[0]) for part in path[1:].split("L")]
    floor, ceiling = 160 - 16, 9
    assert drawn == pytest.approx(floor - (floor - ceiling) * 0.95 * np.minimum(heights, 1.05), abs=1e-6)
    page.locator("#parameter-0").press("PageUp")
    page.wait_for_function("before => document.querySelector('path.here').getAttribute('d') !== before", arg=path)
