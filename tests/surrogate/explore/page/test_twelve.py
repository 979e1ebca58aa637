"""A run of twelve parameters is used on a laptop's screen: rows are low, the panel scrolls, nothing lies over anything."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import torch

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate import Surrogate
from surrogate.deformation import BilinearDeformation
from surrogate.settings import TrainingSettings
from tests.support.browsers import PHONE, NewPage, serious_findings
from tests.support.drawn_pages import opened
from tests.support.explored import go
from tests.support.surrogates import some_surrogate

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
HIGHEST = 60  # pixels of a row
COUNT = 12
ROWS = """() => [...document.querySelectorAll(".parameter")].map(row => {
  const { top, bottom } = row.getBoundingClientRect();
  return [top, bottom];
})"""
WORDS = """() => {
  const all = [...document.querySelectorAll(".annotations text")].filter(text => /=|predicted/.test(text.textContent));
  return all.map(text => {
    const { top, bottom, right } = text.getBoundingClientRect();
    return [text.textContent, top, bottom, right];
  });
}"""


def twelve() -> Surrogate:
    """Of some Gaussians, with names that end in digits, units and a logarithmic scale."""
    made = some_surrogate()
    torch.manual_seed(3)
    deformation = BilinearDeformation.create(made.gaussians, COUNT, TrainingSettings(latent_size=4, hidden_width=8))
    parameters = [
        Parameter(f"density_{i}", 0.01, 1.0 + i, "kg/m³" if i % 2 else "", scale="log" if i % 3 == 0 else "linear")
        for i in range(COUNT)
    ]
    return replace(made, deformation=deformation, space=ParameterSpace(tuple(parameters)))


@pytest.fixture
def laptop(new_page: NewPage, tmp_path: Path) -> Page:
    """A page alone of 1440x900."""
    page = new_page(viewport={"width": 1440, "height": 900})
    opened(page, twelve(), tmp_path)
    return page


def test_every_parameter_has_a_low_row_of_its_own(laptop: Page) -> None:
    rows = laptop.evaluate(ROWS)
    assert len(rows) == COUNT
    assert max(bottom - top for top, bottom in rows) <= HIGHEST
    assert all(later[0] >= earlier[1] for earlier, later in pairwise(rows))
    last = laptop.locator(f"#parameter-{COUNT - 1}")
    last.scroll_into_view_if_needed()
    before = last.input_value()
    last.press("PageUp")  # it is seen and heard
    assert last.input_value() != before
    aside = laptop.locator("aside").evaluate("e => [e.scrollHeight > e.clientHeight, e.scrollWidth > e.clientWidth]")
    assert aside == [True, False]
    assert serious_findings(laptop) == []


def test_words_below_the_bar_are_wider_on_a_small_window(laptop: Page) -> None:
    laptop.set_viewport_size({"width": 1024, "height": 700})
    laptop.wait_for_function("() => window.explorer.resting")
    (_, *beside), (_, *below) = laptop.evaluate(WORDS)[0], laptop.evaluate(WORDS)[2]
    bar = laptop.locator("#top").bounding_box()
    assert bar is not None
    assert beside[2] <= bar["x"] < below[2]
    assert below[0] >= bar["y"] + bar["height"]


def test_the_picture_says_all_of_them_beside_the_bar(laptop: Page) -> None:
    words = laptop.evaluate(WORDS)
    said = " ".join(text for text, *_ in words)
    assert all(f"density_{i} = " in said for i in range(COUNT))
    assert "…" not in said
    bar = laptop.locator("#top").bounding_box()
    assert bar is not None
    assert all(right <= bar["x"] or top >= bar["y"] + bar["height"] for _, top, _, right in words)
    assert all(later[1] >= earlier[2] - 2 for earlier, later in pairwise(words))


def test_captions_of_a_comparison_say_what_differs_and_leave_pictures_free_on_a_phone(
    new_page: NewPage, tmp_path: Path
) -> None:
    page = new_page(viewport=PHONE, has_touch=True)
    opened(page, twelve(), tmp_path)
    go(page, "mode=compare&b.p.density_2=2.5")
    page.wait_for_function("() => document.querySelectorAll('.pane').length === 3")
    first, second, _ = page.locator(".pane .shown").all_inner_texts()
    assert [text.split(" = ")[0] for text in (first, second)] == ["density_2"] * 2
    captions = page.locator(".pane figcaption").evaluate_all("all => all.map(e => e.getBoundingClientRect().right)")
    assert max(captions) < 0.4 * PHONE["width"]
