"""Files and functions stay short enough to be read whole."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent
PACKAGES = ("catalogs", "native", "render", "insitu", "surrogate", "research")
MOST_LINES_OF_A_FILE, MOST_LINES_OF_A_FUNCTION = 400, 60  # of a function without its docstring


def sources(package: str) -> list[Path]:
    return sorted((PROJECT / package).rglob("*.py"))


def lengths(source: str) -> Iterator[tuple[str, int]]:
    """The name and the lines of each function, without its docstring."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            documented = ast.get_docstring(node) is not None
            text = node.body[0]
            skipped = (text.end_lineno or 0) - text.lineno + 1 if documented else 0
            yield node.name, (node.end_lineno or 0) - node.lineno + 1 - skipped


@pytest.mark.parametrize("package", [*PACKAGES, "tests"])
def test_files_are_short(package: str) -> None:
    counts = {path: path.read_text().count("\n") for path in sources(package)}
    assert {str(path): count for path, count in counts.items() if count > MOST_LINES_OF_A_FILE} == {}


@pytest.mark.parametrize("package", PACKAGES)
def test_functions_are_short(package: str) -> None:
    long = [
        f"{path}: {name} has {lines} lines"
        for path in sources(package)
        for name, lines in lengths(path.read_text())
        if lines > MOST_LINES_OF_A_FUNCTION
    ]
    assert long == []


def test_a_docstring_does_not_count() -> None:
    source = 'def first():\n    """One.\n\n    Two.\n    """\n    return 1\n\n\ndef second():\n    return 2\n'
    assert dict(lengths(source)) == {"first": 2, "second": 2}
