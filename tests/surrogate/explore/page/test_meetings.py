"""Combinations of the page's parts: pins under a divider, values while something plays, cuts that leave nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.support.browsers import PHONE, NewPage
from tests.support.explored import go, open_explorer, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

KNOWN = "() => window.explorer.probe.values()"
SEEN = """() => [...document.querySelectorAll('#stage .pane')].map(pane =>
  [...pane.querySelectorAll('.pin-value')].map(made => made.textContent))"""
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
