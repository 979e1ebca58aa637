"""Docstrings, comments, messages and pages are in plain words: see `tests.support.words` for what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.words import PROJECT, checked, in_markdown, in_python, participles, violations

PLACES = (
    "catalogs",
    "render",
    "insitu",
    "surrogate",
    "research",
    "tests",
    "examples",
    "docs",
    "README.md",
    "CONTRIBUTING.md",
)


def refused(path: Path) -> list[str]:
    return [
        f"{file.relative_to(PROJECT)}:{line}: {message}" for file in checked(path) for line, message in violations(file)
    ]


@pytest.mark.parametrize("place", PLACES)
def test_words_are_plain(place: str) -> None:
    assert refused(PROJECT / place) == []


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("There is no file, there are no files, and it is no longer one.", 0),
        ("A field is no number.", 1),
        ("They are no more than two and no larger than three.", 0),
        ("A callable that is told about\neach member and the like.", 2),
        ("An only one of so many.", 2),
        ("Word " * 31 + "end.", 1),
        ("Word " * 20 + "end. " + "Word " * 20 + "end.", 0),
    ],
)
def test_prose(text: str, count: int) -> None:
    found = [message for _, message in in_python(f'"""{text}"""\n', docstrings_only=True)]
    assert len(found) == count, found
    assert sum("characters" not in message for _, message in in_markdown(text)) == count


def test_python() -> None:
    source = '"""What it is."""\nx = "told"  # is no name\ny = f"so many {x}s"\n'
    assert [line for line, _ in in_python(source, docstrings_only=False)] == [1, 3, 2]
    assert len(list(in_python(source, docstrings_only=True))) == 1


def test_names() -> None:
    source = """
def f(known, known_names):
    held, seen_views = known, known_names
    self._found = [taken for taken in held]

class Record:
    made: str
    told: str
    def drawn(self): ...
    def shown(self): ...
"""
    assert [line for line, _ in sorted(participles(source))] == [2, 3, 4, 4, 8, 10]


def test_pages() -> None:
    long = "x" * 121
    assert [line for line, _ in in_markdown(f"{long}\n\n| {long} |\n\n```\n{long}\n```\n")] == [1]
