"""A page alone in a notebook's cell, as the documentation shows it there: the contents of a frame, without an address or a port."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from surrogate import Surrogate
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
DOCS = Path(__file__).parents[4] / "docs" / "how-to" / "send.md"
RESTS = "() => window.explorer?.resting && window.explorer.counted.whole > 0"


@pytest.mark.parametrize("sandbox", ["", ' sandbox="allow-scripts"'], ids=["as it is", "in a sandbox"])
def test_a_cell_shows_a_page_and_its_controls_work(
    page: Page, surrogate: Surrogate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sandbox: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flow.html").write_bytes(page_bytes(Run("blobs", surrogate)))
    (code,) = re.findall(r"```python\nfrom html.*\nHTML\((f'.*')\)\n```", DOCS.read_text(encoding="utf-8"))
    from html import escape

    cell = eval(code, {"escape": escape, "Path": Path})  # as the kernel would
    page.context.set_offline(True)
    page.set_content(cell.replace("<iframe", f"<iframe{sandbox}"))
    frame = page.frames[1]
    frame.wait_for_function(RESTS)
    before = frame.locator("#stage canvas").evaluate("canvas => canvas.toDataURL()")
    frame.locator("#parameter-0").press("End")
    frame.wait_for_function(
        "before => window.explorer.resting && document.querySelector('#stage canvas').toDataURL() !== before",
        arg=before,
    )
    assert "p = 1.12" in (frame.locator(".annotations").first.text_content() or "")
    frame.locator("#stage").press("ArrowLeft")
    frame.wait_for_function(RESTS)
    assert frame.locator("#undo").is_hidden()  # steps would be those of the notebook
