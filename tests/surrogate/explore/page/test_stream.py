"""Of frames that arrive in any order, the newest stays on the screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from tests.support.browsers import NewPage
from tests.support.explored import assert_shown, open_explorer

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow

# Two frames are asked for, a moving and a whole one, and decoded in `order`; the numbers of those that are painted.
STREAM = """async order => {
  const { Stream } = await import("/explore/stream.js");
  const painted = [], decoded = new Map(), tick = () => new Promise(resolve => setTimeout(resolve));
  const show = async (answer, moving, request, isNewest) => {
    await new Promise(resolve => decoded.set(answer, resolve));
    if (isNewest()) painted.push(answer);
  };
  let asked = 0;
  const stream = new Stream(() => asked += 1, async request => request, show, error => painted.push(String(error)));
  stream.change();
  stream.settle();
  while (decoded.size < 2) await tick();
  for (const number of order) {
    decoded.get(number)();
    await tick();
  }
  return [painted, stream.resting];
}"""

# Pictures of a movement take longer to decode than any whole one.
SLOWLY = """
const decode = window.createImageBitmap;
window.createImageBitmap = async (source, ...options) => {
  if (source.type === "image/jpeg") await new Promise(resolve => setTimeout(resolve, 500));
  return decode(source, ...options);
};
"""


@pytest.mark.parametrize(("order", "painted"), [([1, 2], [1, 2]), ([2, 1], [2])])
def test_an_older_frame_is_not_painted_over_a_newer_one(modules: Page, order: list[int], painted: list[int]) -> None:
    assert modules.evaluate(STREAM, order) == [painted, True]


def test_pictures_of_a_movement_that_come_late_are_left_out(
    new_page: NewPage, explorer: str, surrogate: Surrogate
) -> None:
    page = new_page()
    page.add_init_script(SLOWLY)
    open_explorer(page, explorer)
    page.get_by_label("p, exact value", exact=True).fill("0.9")
    page.keyboard.press("Enter")
    assert_shown(page, surrogate)
