"""Combinations of the page's parts: pins under a divider, values while something plays, cuts that leave nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from native.ray_casting.cuts import Cut
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.exporting import exports
from surrogate.explore.exporting.marks import annotated, annotations_of
from surrogate.explore.facts import box_of
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from tests.support.browsers import PHONE, NewPage
from tests.support.explored import go, open_explorer, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

KNOWN = "() => window.explorer.probe.values()"
SEEN = """() => [...document.querySelectorAll('#stage .pane')].map(pane =>
  [...pane.querySelectorAll('.pin-value')].map(made => made.textContent))"""
EDGES = """() => [...document.querySelectorAll('.pin-value')].map(made => {
  const pane = made.closest('.pane'), { left, right } = made.getBoundingClientRect(), all = pane.getBoundingClientRect();
  const divider = parseFloat(document.getElementById('stage').style.getPropertyValue('--swipe')) / 100;
  const most = document.getElementById('swipe') && !pane.previousElementSibling ? divider * all.width : all.width;
  return [left - all.left, right - all.left, most];
})"""
WITHIN = """() => [...document.querySelectorAll('.between')].every(({ offsetLeft, offsetWidth, parentElement }) =>
  offsetLeft >= 0 && offsetLeft + offsetWidth <= parentElement.offsetWidth + 1)"""
INK = "() => getComputedStyle(document.querySelector('.pin-value')).fill"


def test_values_at_pins_stand_over_their_own_picture(page: Page, two: str) -> None:
    open_explorer(page, two, "mode=compare&layout=swipe&a.p.p=0.1&b.p.p=0.9&pins=0.4,0.5,0.6")
    page.wait_for_function(KNOWN)
    values: dict[str, Any] = {}
    for key in ("End", "Home"):  # all of the first, all of the second
        page.locator("#swipe").press(key)
        values[key] = page.evaluate(SEEN)
    assert values["End"][1] == values["Home"][0] == []
    assert len(values["End"][0]) == len(values["Home"][1]) == 1
    assert values["End"][0] != values["Home"][1]


def test_values_at_pins_stay_in_their_picture(new_page: NewPage, two: str) -> None:
    page = new_page(viewport=PHONE, has_touch=True)
    for state in ("mode=compare&layout=swipe", "mode=view"):
        open_explorer(page, two, f"{state}&pins=0.5,0.5,0.5;0.9,0.1,0.1;0.1,0.9,0.9&a.p.p=0.1&b.p.p=0.9")
        page.wait_for_function("() => document.querySelectorAll('.pin-value').length >= 3")
        edges = page.evaluate(EDGES)
        assert all(left >= 0 and right <= most for left, right, most in edges), (state, edges)


def test_values_at_pins_are_read_on_the_background(page: Page, two: str) -> None:
    found = []
    for background in ("%23101216", "%23ffffff"):
        open_explorer(page, two, f"pins=0.4,0.5,0.6&background={background}")
        page.wait_for_function("() => document.querySelector('.pin-value')")
        found.append(page.evaluate(INK))
    assert found == ["rgb(241, 243, 246)", "rgb(16, 18, 22)"]


def test_the_value_under_the_pointer_follows_what_plays(page: Page, two: str) -> None:
    open_explorer(page, two, "a.p.p=0.1&probe=on")
    box = page.locator("#stage canvas").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.46 * box["width"], box["y"] + 0.52 * box["height"])
    page.wait_for_function("() => !document.getElementById('reading').hidden")
    before = page.locator("#reading").inner_text()
    play = page.locator(".play").first
    play.evaluate("made => made.click()")  # the pointer stays where it is
    page.wait_for_function("before => document.getElementById('reading').innerText !== before", arg=before)
    assert play.get_attribute("aria-pressed") == "true"
    play.evaluate("made => made.click()")


def test_a_cut_that_leaves_nothing_is_said(page: Page, two: str) -> None:
    open_explorer(page, two)
    low, high = page.evaluate("window.explorer.facts.box")
    middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    cases = {
        f"a.clip={low[0] - 2},{low[1]},{low[2]},{low[0] - 1},{high[1]},{high[2]}": True,
        f"a.slice=z,{high[2] + 1}": True,
        f"a.slice=z,{middle[2]}": False,
        f"a.clip={','.join(map(str, [*low, *middle]))}&a.slice=x,{middle[0]}": False,
        f"a.clip={','.join(map(str, [*low, *middle]))}": False,
        "a.p.p=0.4": False,
    }
    for address, is_empty in cases.items():
        go(page, address)
        settled(page)
        assert page.get_by_text("Nothing is left to draw").is_visible() == is_empty, address
        assert page.evaluate(WITHIN), address


def test_parts_of_a_link_are_named_and_the_note_closes_on_a_phone(new_page: NewPage, two: str) -> None:
    page = new_page(viewport=PHONE, has_touch=True)
    open_explorer(page, two, "mode=compare&against=three&c.p.p=nothing&d.p.q=1e9")
    lines = page.locator("#note li").all_inner_texts()
    assert [line.split(" = ")[0] for line in lines] == ["C: p", "D: q"]
    close = page.locator("#note button").bounding_box()
    assert close is not None
    assert close["width"] > 1.3 * close["height"]  # one line


def test_names_that_do_not_fit_keep_their_ends(page: Page, two: str) -> None:
    open_explorer(page, two)
    elided = page.evaluate(
        """async cases => {
          const { elided } = await import(new URL("explore/parallel.js", document.baseURI));
          return cases.map(([text, room]) => elided(text, room, word => word.length));
        }""",
        [["density_1", 20], ["density_1", 6], ["density_1", 5], ["density_1", 1], ["Re", 2]],
    )
    assert elided == ["density_1", "den…_1", "de…_1", "d…1", "Re"]


def test_each_picture_of_a_saved_comparison_has_its_own_cut(two_run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(
        exports,
        "comparison",
        lambda first, second, words, over, **rest: drawn.extend([over(first, 0), over(second, 1)]),
    )
    (low, high), camera = box_of(two_run), two_run.cameras[0]
    settings = [Setting({"p": 0.4, "q": 10.0}, cut=cut) for cut in (Cut(plane=(2, (low[2] + high[2]) / 2)), None)]
    exports.ComparisonRequest(settings[0], camera, settings[1], annotations=("box",)).content(two_run, print)
    for picture, setting in zip(drawn, settings, strict=True):
        plain = setting.member(two_run.surrogate).render(camera, background=WHITE)[..., :3]
        np.testing.assert_array_equal(
            picture, annotated(plain, annotations_of(two_run, setting, ("box",)), camera, WHITE)
        )


def test_numbers_on_the_way_between_snapshots_have_few_digits(page: Page, two: str) -> None:
    open_explorer(page, two)
    setting = page.evaluate(
        """async addresses => {
          const { stateOf } = await import("/explore/address.js"), { stateBetween } = await import("/explore/journey.js");
          const [first, last] = addresses.map(address => stateOf(address, window.explorer.facts).state);
          return stateBetween(first, last, 0.3, window.explorer.facts).settings[0];
        }""",
        ["#a.p.p=0.1&a.p.q=1.7&a.slice=z,0.1", "#a.p.p=0.7&a.p.q=31&a.slice=z,0.9&a.clip=0,0,0,0.5,1,1"],
    )
    for value in (*setting["parameters"].values(), setting["slice"][1], *setting["clip"]):
        assert len(str(value)) <= 8, setting
