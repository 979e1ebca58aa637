"""Valid typed numbers are drawn and shown; beside others the input says why not, and shows the drawn value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from surrogate import Surrogate
from tests.support.explored import assert_shown, go, open_explorer, request_of

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


EXTRAPOLATED = [("p, exact value", "1.75"), ("c1 opacity", "0.9"), ("c2 value", "2.9")]


def asked(page: Page) -> dict[str, Any]:
    """Parameters and visualization of what is drawn."""
    setting = request_of(page)["settings"][0]
    return {**setting["parameters"], **setting["visualization"]}


CASES = [  # state, label, typed, what is drawn, what is said
    ("", "p, exact value", "0.9", {"p": 0.9}, ""),
    ("", "p, exact value", "0.123456789012", {"p": 0.123456789012}, ""),
    ("", "p, exact value", "1.75", {"p": 1.75}, ""),
    ("", "p, exact value", "99999", {"p": 0.5}, "99999 can't be drawn: p goes from −1 to 2, and stays 0.5."),
    ("", "p, exact value", "", {"p": 0.5}, "That is not a number: p goes from −1 to 2, and stays 0.5."),
    ("a.show=isovalue", "isovalue, exact value", "100", {"isovalue": 0.45}, "100 can't be drawn"),
    ("a.show=transfer_function", "c1 opacity", "0.9", {"c1_opacity": 0.6}, ""),
    (
        "a.show=transfer_function",
        "c1 opacity",
        "1.5",
        {"c1_opacity": 0.0},
        "1.5 can't be drawn: c1 opacity goes from 0 to 1",
    ),
    ("a.show=transfer_function", "c2 value", "2.9", {"c2_value": 0.9}, ""),
    (
        "a.show=transfer_function",
        "c2 value",
        "0.9",
        {"c2_value": 0.0},
        "0.9 can't be drawn: c2 value goes from 1.002 to",
    ),
]


def test_an_input_shows_what_is_drawn(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    refused, extrapolated = page.locator(".refused:visible"), page.locator(".warning.outside:visible")
    for number, (state, label, text, drawn, said) in enumerate(CASES):
        go(page, f"{state}&{number}")  # a state of its own
        if label.startswith("c"):  # the numbers of the point that has the focus
            page.get_by_role("slider", name=f"Control point {label[:2]}").focus()
        typed = page.get_by_label(label, exact=True)
        before = float(typed.input_value())
        typed.fill(text)
        page.keyboard.press("Enter")
        assert_shown(page, surrogate)
        assert {name: asked(page).get(name, 0.0) for name in drawn} == pytest.approx(drawn, abs=1e-12)
        assert float(typed.input_value()) == pytest.approx(before if said else float(text), rel=1e-7)
        assert float(typed.get_attribute("title") or "") == (before if said else float(text))
        assert [said in found for found in refused.all_inner_texts()] == [True] * bool(said)
        assert extrapolated.count() == ((label, text) in EXTRAPOLATED)
        typed.fill("0.4")  # what is typed anew is not complained of any more
        assert refused.count() == 0


def test_the_ends_of_a_sweep_are_typed_in_the_same_way(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, "mode=sweep&a.show=transfer_function&sweep.name=c2_opacity&sweep.count=3")
    assert [page.locator(f"#sweep-{end}").input_value() for end in ("low", "high")] == ["0.2", "0.8"]  # places of c2
    page.locator("#sweep-high").fill("0.7")
    page.keyboard.press("Enter")
    assert_shown(page, surrogate, 2)
    shown = [s["visualization"]["c2_opacity"] for s in request_of(page)["settings"]]
    assert shown == pytest.approx([-0.3, -0.05, 0.2])
    assert "c2_opacity = 0.7" in page.locator("#stage figcaption").nth(2).inner_text()
    page.locator("#sweep-high").fill("0.1")
    page.keyboard.press("Enter")
    assert "0.1 can't be drawn: c2_opacity goes from 0.2" in page.locator(".refused:visible").inner_text()
    assert page.locator("#sweep-high").input_value() == "0.7"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (-7.890094408123e-10, "-7.8901e-10"),
        (-1 / 3, "-0.33333333"),
        (1234.5, "1234.5"),
        (1e300, "1e+300"),
        (-1.23456789e-300, "-1.235e-300"),
        (0.1 + 0.2, "0.3"),
        (0, "0"),
    ],
)
def test_a_number_that_does_not_fit_loses_digits_and_not_its_exponent(modules: Page, value: float, text: str) -> None:
    shown = modules.evaluate("async x => (await import('/explore/numbers.js')).fitting(x)", value)
    assert len(shown) <= 10
    assert float(shown) == pytest.approx(value, rel=1e-3)
    assert shown == text or len(text) > 10


def test_a_shortened_number_that_is_entered_again_stays(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, "a.p.p=0.123456789012345")
    page.get_by_label("p, exact value").fill("0.5")
    page.get_by_label("p, exact value").fill("0.1234568")
    page.keyboard.press("Enter")
    assert_shown(page, surrogate)
    assert asked(page)["p"] == 0.123456789012345
