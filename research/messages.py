"""Every error and warning that the packages can give, collected from their code.

    python -m research.messages [WORDS...]        prints those that hold all words

`docs/conf.py` makes a page of them.  A message says its remedy itself: there is no other list to keep.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PROJECT = Path(__file__).resolve().parents[1]
PACKAGES = ("catalogs", "native", "insitu", "render", "surrogate")
WARNINGS = {"warn", "warn_of", "_warn"}
LEAST_WORDS = 3  # shorter texts are keys and names
GAP = "…"  # in place of a value


class Message(NamedTuple):
    """A text with gaps for its values, the name of the error or warning, and the module that gives it."""

    text: str
    kind: str
    module: str


def text_of(node: ast.expr) -> str:
    """The text that an expression makes, with gaps for what only running tells; "" for what is not text."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part) if isinstance(part, ast.Constant) else GAP for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = text_of(node.left), text_of(node.right)
        return f"{left or GAP}{right or GAP}" if left or right else ""
    if isinstance(node, ast.IfExp):
        return text_of(node.body) or text_of(node.orelse)
    return ""


def name_of(node: ast.expr) -> str:
    """The last name of what is called."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def of_source(source: str, module: str) -> Iterator[Message]:
    """The messages of a module's text."""
    tree = ast.parse(source)
    raised = {id(node.exc) for node in ast.walk(tree) if isinstance(node, ast.Raise)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        kind = name_of(node.func)
        if id(node) not in raised and kind not in WARNINGS and not kind.endswith(("Warning", "Exception", "Error")):
            continue
        text = " ".join(text_of(node.args[0]).split())
        if len(text.replace(GAP, " ").split()) >= LEAST_WORDS:
            public = kind[0].isupper()
            yield Message(text, kind if public else "warning" if kind in WARNINGS else "error", module)


def messages() -> list[Message]:
    """All of them, each once, by module and text."""
    found = set()
    for package in PACKAGES:
        for path in sorted((PROJECT / package).rglob("*.py")):
            parts = path.relative_to(PROJECT).with_suffix("").parts
            module = ".".join(part for part in parts if part != "__init__")
            found |= set(of_source(path.read_text(encoding="utf-8"), module))
    return sorted(found, key=lambda message: (message.module, message.text))


if __name__ == "__main__":
    for message in messages():
        if all(word.lower() in message.text.lower() for word in sys.argv[1:]):
            print(f"{message.module} {message.kind}: {message.text}")
