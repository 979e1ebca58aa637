"""The address is the whole state: whatever is set by hand is there again after a reload, and the pictures are the same."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.support.explored import addressed, drag, go, open_explorer, settled, shown

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def typed(page: Page, label: str, text: str) -> None:
    page.get_by_label(label, exact=True).fill(text)
    page.keyboard.press("Enter")


def viewed(page: Page) -> None:
    page.locator("#kind-isovalue").click()
    page.locator("#isovalue").press("ArrowLeft")
    page.locator("#kind-transfer_function").click()  # the isovalue is not seen any more, but kept
    drag(page, ".transfer .handle >> nth=2", -20, -10)
    page.get_by_role("slider", name="Control point c1").focus()
    typed(page, "c1 opacity", "0.9")
    page.get_by_role("button", name="turbo").click()
    drag(page, "#stage", 70, 30)
    page.mouse.wheel(0, 200)
    page.locator("#background").select_option("#ffffff")
    page.locator("#full").select_option("256")


def compared(page: Page) -> None:
    page.locator("#mode-compare").click()
    page.locator("#edit-B").click()
    typed(page, "p, exact value", "0.9")
    page.locator("#kind-isovalue").click()
    typed(page, "isovalue, exact value", "0.123456789")
    drag(page, "#stage canvas >> nth=1", 30, 10, key="Shift")


def compared_then_viewed(page: Page) -> None:
    compared(page)
    page.locator("#mode-view").click()


def beside_the_truth(page: Page) -> None:
    page.locator("#mode-compare").click()
    page.locator("#against").select_option("truth")
    page.locator("#member").select_option(label="test-0: 0.75")
    page.get_by_role("button", name="Nearest stored picture").click()


def swept(page: Page) -> None:
    compared(page)
    page.locator("#mode-sweep").click()
    page.locator("#sweep-low").fill("0.25")
    page.keyboard.press("Enter")
    page.locator("#sweep-count").select_option("3")
    page.locator("#sweep-second").select_option("isovalue")
    page.locator("#sweep-secondHigh").fill("0.5")
    page.keyboard.press("Enter")
    page.locator("#sweep-rows").select_option("2")


def swept_then_compared(page: Page) -> None:
    swept(page)
    page.locator("#mode-compare").click()


def state_of(page: Page) -> Any:
    return page.evaluate("JSON.parse(JSON.stringify(window.explorer.state))")


@pytest.mark.parametrize(
    "operate", [viewed, compared, compared_then_viewed, beside_the_truth, swept, swept_then_compared]
)
def test_a_reload_changes_nothing(page: Page, explorer: str, operate: Callable[[Page], None]) -> None:
    open_explorer(page, explorer)
    first = state_of(page)
    operate(page)
    addressed(page)
    state, pictures = state_of(page), [shown(page, i) for i in range(page.locator("#stage canvas").count())]
    assert state != first
    page.reload()
    settled(page)
    assert state_of(page) == state
    assert page.locator("#note").is_hidden()
    assert page.locator("#stage canvas").count() == len(pictures)
    for i, picture in enumerate(pictures):
        np.testing.assert_array_equal(shown(page, i), picture)


RANDOM_STATES = """async count => {
  const [{ addressOf, stateOf }, states, { rounded }] =
    await Promise.all(["address", "state", "orbit"].map(name => import(`/explore/${name}.js`)));
  const { firstState, kindsOf, possibleSweep, sweepable, current, variation, pointsOf, MODES, FULL_SIZES } = states;
  const facts = window.explorer.facts, wrong = [], random = Math.random, pick = from => from[Math.floor(random() * from.length)];
  const between = p => pick([p.low, p.least, p.most, p.least + random() * (p.most - p.least)]);
  const setting = first => {
    const made = structuredClone(first);
    for (const p of facts.parameters) made.parameters[p.name] = between(p);
    made.kind = pick(kindsOf(facts));
    made.isovalue = between(variation(facts, "isovalue"));
    for (const p of pointsOf(facts)) if (random() < 0.5) made.points[p.name] = p.low + random() * (p.high - p.low);
    if (made.points.c1_value >= made.points.c2_value) made.points = first.points;
    if (random() < 0.3) {
      const values = [0, 1, 2, 3].map(i => i + random());
      const colors = pick([null, values.slice(1).map(x => [x, pick(["#00ff7f", "#123456"])])]);
      Object.assign(made, { points: { ...first.points }, free: { opacity: values.map(x => [x, random()]), colors } });
    }
    made.colorMap = pick(["", "viridis", "gray"]);
    made.using = pick(["", ...facts.model.representations.map(one => one.name)]);
    return made;
  };
  const sweep = state => {
    const known = sweepable(facts, current(state)), first = pick(known), second = pick([undefined, ...known]);
    const name = second && second !== first ? second.name : "";
    const made = { ...state.sweep, name: first.name, count: 2 + Math.floor(10 * random()), second: name };
    if (random() < 0.5) Object.assign(made, { low: first.low, high: first.low + random() * (first.most - first.low) });
    if (name && random() < 0.5) made.secondHigh = second.high + 0.5 * (second.most - second.high);
    return possibleSweep({ ...state, sweep: made }, facts);
  };
  for (let i = 0; i < count; i += 1) {
    const state = firstState(facts), [a, b] = state.settings, one = setting(a);
    state.settings = [one, random() < 0.7 ? setting(b) : structuredClone(one)];
    Object.assign(state, { mode: pick(MODES), active: pick([0, 1]), against: pick(["setting", "truth"]), full: pick(FULL_SIZES) });
    const target = [1e6 * random(), -random(), 0], distance = 10 ** (4 * random() - 2);
    Object.assign(state, { background: pick(["#000000", "#12ab9f"]), sweep: sweep(state) });
    state.orbit = rounded({ ...state.orbit, distance, target, field: 1 + 149 * random() });
    const { state: again, notes } = stateOf(addressOf(state, facts), facts);
    if (notes.length || JSON.stringify(again) !== JSON.stringify(state)) wrong.push([addressOf(state, facts), notes, state, again]);
  }
  return wrong;
}"""


def test_any_state_goes_through_the_address(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    wrong = page.evaluate(RANDOM_STATES, 500)
    assert wrong == []


CHANGED: list[tuple[str, list[str]]] = [
    ("a.p.p=99999", ["A: p = 99999 can't be drawn, only −1 to 2: 1 instead"]),
    ("a.p.p=x&b.p.p=0.1", ["A: p = x is not a number: 0.5 instead"]),
    ("a.p.q=1", ["a.p.q is not part of a link: left out"]),
    ("mode=fly", ["mode = fly is unknown here: view instead"]),
    ("a.show=field", ["A: show = field is unknown here: transfer_function instead"]),
    (
        "a.function=0,0.5;1,0.2;1,0.3",
        ["A: function = 0,0.5;1,0.2;1,0.3 has points of opacity whose values do not increase: the base instead"],
    ),
    ("a.function=0,0.5;1,1.2", ["A: function = 0,0.5;1,1.2 has opacities outside 0 to 1: the base instead"]),
    ("a.function=0,0.5", ["A: function = 0,0.5 has 1 points of opacity, not 2 to 256: the base instead"]),
    (
        "a.function=0,0;1,1|0,ff;1,00ff00",
        ["A: function = 0,0;1,1|0,ff;1,00ff00 is not a list of control points: the base instead"],
    ),
    ("a.function=0,0;1,x", ["A: function = 0,0;1,x has values other than numbers: the base instead"]),
    ("a.function=0,0;0.5,1;3,0.25|0,ff0000;2,00ff00", []),
    ("a.c1=2.1,0.3", ["the control points cross: they stand where they were at first"]),
    ("a.c1=1.2", ["A: c1 = 1.2 is not a value and opacity: 1,0.3 instead"]),
    (
        "sweep.low=0.9&sweep.high=0.1",
        ["a sweep goes from a value to a larger one, not from 0.9 to 0.1: over the bounds instead"],
    ),
    ("sweep.count=99", ["sweep.count = 99 is not 2 to 24: 7 instead"]),
    ("camera=1,2", ["camera = 1,2 is not a camera: the first view instead"]),
    ("background=red", ["background = red is not a colour #rrggbb: #101216 instead"]),
    ("a.p.p=1.9", []),  # extrapolated
    ("a.c1_value=0.1", ["a.c1_value is not part of a link: left out"]),
]


def test_a_link_that_cannot_be_followed_says_what_was_changed(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    for address, notes in CHANGED:
        go(page, address)
        assert page.locator("#note li").all_inner_texts() == notes
        assert page.locator("#note").is_visible() == bool(notes)
