"""Two pictures in one place: a divider shows more of the one or of the other."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from surrogate import Surrogate
from tests.support.browsers import serious_findings
from tests.support.explored import assert_shown, open_explorer, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def seen(page: Page) -> np.ndarray:
    """The stage as it is displayed, (H, W, 3), without what lies at its edges."""
    picture = Image.open(io.BytesIO(page.locator("#stage").screenshot())).convert("RGB")
    return np.asarray(picture, dtype=np.float64)[120:-60]


@pytest.mark.parametrize("state", ["b.p.p=0.95&a.p.p=0.1", "against=truth&a.p.p=0.5"])
def test_a_divider_shows_one_or_the_other(page: Page, explorer: str, surrogate: Surrogate, state: str) -> None:
    open_explorer(page, explorer, f"mode=compare&layout=swipe&hide=box&{state}")
    assert_shown(page, surrogate)
    divider = page.locator("#swipe")
    divider.press("Home")  # all of the second
    second = seen(page)
    divider.press("End")
    first = seen(page)
    divider.fill("50")
    both = seen(page)
    half = both.shape[1] // 2
    np.testing.assert_allclose(both[:, : half - 20], first[:, : half - 20], atol=1)
    np.testing.assert_allclose(both[:, half + 20 :], second[:, half + 20 :], atol=1)
    assert page.locator("#compared").inner_text() != ""
    assert not serious_findings(page)
    page.locator("#layout").select_option("side")
    settled(page)
    assert page.locator("#swipe").count() == 0
    assert page.locator("#stage canvas:visible").count() == 3
