"""Lines of at most 120 characters for the Markdown that research writes."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator

WIDTH = 120
WHOLE = re.compile(r"\||#|!\[|<!--|    ")  # tables, headings, pictures, comments and code
ITEM = re.compile(r"\s*(?:[-*] |\d+\. )")


def wrapped(text: str) -> str:
    """The page with its prose wrapped; tables, headings, pictures, comments and code stay as they are."""
    return "\n".join(_lines(text.split("\n")))


def _lines(rows: list[str]) -> Iterator[str]:
    gathered: list[str] = []
    code = False
    for row in rows:
        fence = row.startswith("```")
        whole = code or fence or not row.strip() or (WHOLE.match(row) is not None and not (gathered and row[0] == " "))
        code ^= fence
        if gathered and (whole or ITEM.match(row) or row.startswith("<sub>")):
            yield from _paragraph(gathered)
            gathered = []
        if whole:
            yield row
        else:
            gathered.append(row)
            if row.endswith("  "):  # a line break
                yield from _paragraph(gathered)
                gathered = []
    if gathered:
        yield from _paragraph(gathered)


def _paragraph(rows: list[str]) -> list[str]:
    """The lines of one paragraph or list item."""
    lead = marker[0] if (marker := ITEM.match(rows[0])) else ""
    body = " ".join(row.strip() for row in rows)[len(lead.strip()) :].strip()
    lines = textwrap.wrap(
        body,
        WIDTH,
        initial_indent=lead,
        subsequent_indent=" " * len(lead),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [*lines[:-1], lines[-1] + ("  " if rows[-1].endswith("  ") else "")]
