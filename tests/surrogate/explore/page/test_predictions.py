"""Predictions all over the parameters: drawn, brushed by hands and keys, and gone to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from surrogate.explore.run import Run
from tests.support.browsers import serious_findings
from tests.support.drawn_pages import opened
from tests.support.explored import addressed, go, open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

SHOWN = "() => !document.querySelector('.tools-of-predictions').hidden"
AXES = "window.explorer.predictions.plot.axes"


def open_drawer(page: Page) -> None:
    page.locator(".drawer > summary").press("Enter")
    page.wait_for_function(SHOWN, timeout=60_000)


def rows(page: Page) -> dict[str, Any]:
    """The values of all rows on each axis, by its key."""
    return {axis["key"].removeprefix("field."): np.array(axis["values"]) for axis in page.evaluate(AXES)}


def said(page: Page) -> str:
    return page.locator(".predictions .said").inner_text()


def axis_at(page: Page, number: int, share: float) -> tuple[float, float]:
    """The place on the screen of a share of an axis."""
    box = page.locator(".parallel").bounding_box()
    assert box is not None
    x, y = page.evaluate(
        "([i, share]) => { const plot = window.explorer.predictions.plot; return [plot.x(i), plot.y(share)]; }",
        [number, share],
    )
    return box["x"] + x, box["y"] + y


def test_outcomes_are_the_fields_and_brushing_them_finds_parameters(page: Page, two: str, two_run: Run) -> None:
    open_explorer(page, two)
    open_drawer(page)
    assert "500 predictions, 17 runs solid" in said(page)
    assert not serious_findings(page)
    values, field = rows(page), two_run.surrogate.field
    assert field is not None
    for i in (20, 300):
        own = field.fields({"p": values["p"][i], "q": values["q"][i]})[0]
        samples, level = own.values, float(page.locator("#level").input_value())
        found = [values[key][i] for key in ("mean", "minimum", "maximum")]
        assert found == pytest.approx([samples.mean(), samples.min(), samples.max()], abs=1e-5)
        assert values["share"][i] == pytest.approx((samples > level).mean(), abs=0.02)  # linear between levels
        appearance: Any = field.appearances[0]
        assert values["opacity"][i] == pytest.approx(appearance.transfer_function.opacities(samples).mean(), abs=5e-3)
    maximum = [axis["key"] for axis in page.evaluate(AXES)].index("field.maximum")
    page.mouse.move(*axis_at(page, maximum, 0.9))
    page.mouse.down()
    page.mouse.move(*axis_at(page, maximum, 0.7), steps=3)
    page.mouse.up()
    brush = page.evaluate("window.explorer.predictions.plot.brushes['field.maximum']")
    assert brush == pytest.approx([0.7, 0.9], abs=0.01)
    shares = (values["maximum"] - values["maximum"].min()) / np.ptp(values["maximum"])
    passes = (shares >= brush[0]) & (shares <= brush[1])
    assert said(page) == f"{passes[17:].sum()} of 500 predictions and {passes[:17].sum()} of 17 runs pass."
    nearest = int(np.where(passes, np.abs(shares - np.mean(brush)), np.inf).argmin())
    page.locator("#go-to").select_option(index=1)
    settled(page)
    gone = request_of(page)["settings"][0]["parameters"]
    assert [gone["p"], gone["q"]] == pytest.approx([values["p"][nearest], values["q"][nearest]], rel=1e-6)
    page.mouse.click(*axis_at(page, maximum, 0.8))  # inside, without a move
    assert "500 predictions" in said(page)


def test_a_press_on_a_line_goes_there(page: Page, two: str) -> None:
    open_explorer(page, two)
    open_drawer(page)
    values = rows(page)
    page.mouse.move(*axis_at(page, 0, 0.52))
    page.mouse.down()
    page.mouse.move(*axis_at(page, 0, 0.48), steps=3)
    page.mouse.up()
    first, second = (axis_at(page, i, share) for i, share in ((0, 0.5), (1, 0.5)))
    row = page.evaluate("window.explorer.predictions.plot.passes.findIndex(Boolean)")
    shares = values["p"][row], np.log10(values["q"][row]) / 2.0
    ends = [axis_at(page, i, float(share)) for i, share in enumerate(shares)]
    x = (first[0] + second[0]) / 2
    page.mouse.move(x, (ends[0][1] + ends[1][1]) / 2)
    named = said(page)
    page.mouse.down()
    page.mouse.up()
    settled(page)
    gone = request_of(page)["settings"][0]["parameters"]
    assert gone["p"] == pytest.approx(0.5, abs=0.05)
    assert f"p = {gone['p']:.4g}" in named


def test_keys_brush_and_clear(page: Page, two: str) -> None:
    open_explorer(page, two)
    open_drawer(page)
    values = rows(page)
    low = page.get_by_role("slider", name="p: lower end of the brush")
    low.focus()
    for _ in range(5):
        page.keyboard.press("PageUp")
    assert low.get_attribute("aria-valuetext") == "0.5"
    passes = values["p"] >= 0.5 - 1e-9
    assert f"{passes[17:].sum()} of 500 predictions" in said(page)
    page.get_by_role("slider", name="p: upper end of the brush").press("Shift+ArrowDown")
    assert page.evaluate("window.explorer.predictions.plot.brushes.p") == pytest.approx([0.5, 0.998])
    low.press("Delete")
    assert page.evaluate("window.explorer.predictions.plot.brushes") == {}
    low.press("ArrowUp")
    page.locator("#clear-brushes").press("Enter")
    assert page.evaluate("window.explorer.predictions.plot.brushes") == {}
    page.locator("#level").fill("0.25")
    page.locator("#level").press("Enter")
    assert any(axis["label"].endswith(" > 0.25") for axis in page.evaluate(AXES))
    addressed(page)
    assert "level=0.25" in page.evaluate("location.hash")
    page.locator("#toggle-theme").click()
    assert not serious_findings(page)
    page.locator("#close-predictions").press("Enter")
    assert not page.evaluate("window.explorer.predictions.isOpen")


def test_links_hold_brushes(page: Page, two: str) -> None:
    open_explorer(page, two, "brush.p=0.25,0.5&brush.field.maximum=0,0.75&level=0.3&brush.q=0.9,0.1&brush.z=0,1")
    page.wait_for_function(SHOWN, timeout=60_000)
    note = page.locator("#note").inner_text()
    assert "brush.q = 0.9,0.1 is not a part of an axis" in note
    assert "brush.z is not part of a link" in note
    values = rows(page)
    shares = (values["maximum"] - values["maximum"].min()) / np.ptp(values["maximum"])
    passes = (values["p"] >= 0.25) & (values["p"] <= 0.5) & (shares <= 0.75)
    assert f"{passes[17:].sum()} of 500 predictions" in said(page)
    assert page.locator("#level").input_value() == "0.3"
    page.get_by_role("slider", name="p: lower end of the brush").press("Delete")
    addressed(page)
    assert page.evaluate("window.explorer.state.brushes") == {"field.maximum": [0, 0.75]}
    page.locator(".steps button").first.click()  # undone
    settled(page)
    page.wait_for_function(
        "count => document.querySelector('.said').textContent.startsWith(count)", arg=str(passes[17:].sum())
    )
    go(page, "#a.p.p=0.5&level=much")
    settled(page)
    assert "level = much is not a number" in page.locator("#note").inner_text()
    page.wait_for_function("() => document.querySelector('.said').textContent.startsWith('500 predictions')")


def test_a_run_without_a_field_says_so(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    page.locator(".drawer > summary").press("Enter")
    page.wait_for_function("() => document.querySelector('.predictions .said').innerText.includes('no emulated field')")


def test_a_page_alone_predicts_by_itself_and_phones_show_it(phone: Page, two_run: Run, tmp_path: Path) -> None:
    opened(phone, two_run.surrogate, tmp_path, modes=12)
    open_drawer(phone)
    assert "500 predictions." in said(phone)
    values, field = rows(phone), two_run.surrogate.field
    assert field is not None
    own = field.fields({"p": values["p"][7], "q": values["q"][7]})[0].values
    found = [values[key][7] for key in ("mean", "minimum", "maximum")]
    assert found == pytest.approx([own.mean(), own.min(), own.max()], abs=2e-3)
    assert np.histogram(values["p"], 5, (0.0, 1.0))[0] == pytest.approx(100, abs=5)
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    assert not serious_findings(phone)
