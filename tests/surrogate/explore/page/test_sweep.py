"""A sweep shows every value, its words beside the pictures, and opens each of them."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest

from surrogate import Surrogate
from tests.support.explored import assert_shown, open_explorer, request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def test_a_sweep_shows_every_value(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, "a.show=isovalue&a.isovalue=0.3")
    page.locator("#mode-sweep").click()
    page.locator("#sweep-count").select_option("4")
    settled(page)
    assert [s["parameters"]["p"] for s in request_of(page)["settings"]] == pytest.approx([0, 1 / 3, 2 / 3, 1])
    pictures = [assert_shown(page, surrogate, number) for number in range(4)]
    assert all(np.abs(a - b).max() > 2 / 255 for a, b in itertools.pairwise(pictures))
    page.locator("#sweep-second").select_option("isovalue")
    page.locator("#sweep-rows").select_option("3")
    settled(page)
    assert page.locator("#stage canvas").count() == 12
    asked = [(s["parameters"]["p"], s["visualization"]["isovalue"]) for s in request_of(page)["settings"]]
    assert len(set(asked)) == 12
    assert_shown(page, surrogate, 11)
    heads = page.locator("#stage .head").all_inner_texts()
    assert heads[:4] == ["p = 0", "p = 0.33333", "p = 0.66667", "p = 1"]
    assert [head.split(" ")[0] for head in heads[4:]] == ["isovalue"] * 3
    for caption, canvas in zip(
        page.locator("#stage figcaption").all(), page.locator("#stage canvas").all(), strict=True
    ):
        above, below = canvas.bounding_box(), caption.bounding_box()
        assert above is not None
        assert below is not None
        assert below["y"] >= above["y"] + above["height"] - 0.5  # words cover no picture
    page.locator("#stage .open").nth(7).click()
    assert_shown(page, surrogate)
    setting = request_of(page)["settings"][0]
    assert (setting["parameters"]["p"], setting["visualization"]["isovalue"]) == asked[7]
