"""Parsing of HTML cards, and names that would break out of them."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

HOSTILE = """<script>alert(1)</script>" onerror='x' & <b>\udcff"""


class Tags(HTMLParser):
    """The tags, their attributes, and the text of a piece of HTML; fails where tags do not match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def images(html: str) -> list[bytes]:
    """The PNG files in a piece of HTML."""
    return [base64.b64decode(found) for found in re.findall(r'src="data:image/png;base64,([^"]*)"', html)]
