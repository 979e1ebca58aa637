"""Make the README's links absolute, for PyPI's page, which has none of our files.

    python .ci/absolute_links.py https://github.com/OWNER/NAME REVISION

The workflow that builds a release runs this before it builds, so the address stands nowhere else.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

README = Path(__file__).resolve().parent.parent / "README.md"
LINK = re.compile(r"(!?)(\[[^\]]*\])\((?!\w+://|#)([^)\s]+)\)")


def absolute(text: str, address: str, revision: str) -> str:
    """The Markdown `text` with links to files of the repository at `address`, as it was at `revision`."""

    def replaced(match: re.Match[str]) -> str:
        picture, label, path = match.groups()
        return f"{picture}{label}({address}/{'raw' if picture else 'blob'}/{revision}/{path})"

    return LINK.sub(replaced, text)


if __name__ == "__main__":
    README.write_text(absolute(README.read_text(encoding="utf-8"), *sys.argv[1:3]), encoding="utf-8")
