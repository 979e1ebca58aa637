"""Code in the pages of docs/, for tests that run it."""

from __future__ import annotations

import re
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent.parent


def documented_code(page: str, section: str) -> list[str]:
    """The code blocks of a page's section, in their order."""
    text = (PROJECT / page).read_text()
    body = re.search(rf"^## {re.escape(section)}\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE)
    assert body is not None, f"{page} has no section {section!r}"
    return re.findall(r"^```\w+\n(.*?)^```", body[1], re.DOTALL | re.MULTILINE)
