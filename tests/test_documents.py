"""Links, files and commands that README, CONTRIBUTING and docs/ name exist."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from urllib.parse import unquote

import pytest

from catalogs.cli import main as catalogs
from insitu.cli import main as insitu
from surrogate.cli import main as surrogate

PROJECT = Path(__file__).resolve().parent.parent
MADE = {"generated", "gallery"}  # folders of docs/ that the build of the site writes
DOCUMENTS = [
    PROJECT / "README.md",
    PROJECT / "CONTRIBUTING.md",
    *sorted(
        path for path in (PROJECT / "docs").rglob("*.md") if not MADE.intersection(path.relative_to(PROJECT).parts)
    ),
    PROJECT / "docs" / "start" / "tutorial.ipynb",
    PROJECT / "research" / "records" / "README.md",
]
LINK = re.compile(r"\]\(([^)\s]+)\)")
FILE = re.compile(r"`((?:catalogs|native|render|insitu|surrogate|research|tests|scenes|docs)/[\w/.-]+)`")
MODULE = re.compile(r"python\s+-m\s+((?:research|insitu|surrogate|catalogs)[\w.]*\w)")
COMMAND = re.compile(r"(?<![\w./-])(insitu|surrogate|catalogs) ([a-z][a-z-]+)\b")
BY_THE_BUILD = re.compile(r"(?:\.\./)*gallery/\w+")  # pages of the site that `make docs` writes and checks
TARGET = re.compile(r"^`?make ([a-z][a-z-]*(?: [a-z][a-z-]*)*)")

every_document = pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(PROJECT)))


@every_document
def test_links_lead_somewhere(document: Path) -> None:
    targets = [unquote(link.split("#")[0]) for link in LINK.findall(document.read_text()) if "://" not in link]
    lost = [target for target in targets if not (document.parent / target).exists()]
    assert [target for target in lost if not BY_THE_BUILD.fullmatch(target)] == []


@every_document
def test_sections_that_are_linked_exist(document: Path) -> None:
    links = [link.partition("#") for link in LINK.findall(document.read_text()) if "#" in link and "://" not in link]
    lost = [
        (page, anchor)
        for page, _, anchor in links
        if anchor not in anchors(document.parent / page if page else document)
    ]
    assert lost == []


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@every_document
def test_files_that_are_named_exist(document: Path) -> None:
    assert [name for name in FILE.findall(document.read_text()) if not (PROJECT / name).exists()] == []


@every_document
def test_commands_that_are_named_exist(document: Path) -> None:
    named = set(MODULE.findall(document.read_text()))
    assert sorted(name for name in named if importlib.util.find_spec(name) is None) == []


@every_document
def test_subcommands_that_are_named_exist(document: Path) -> None:
    text = document.read_text()
    quoted = re.findall(r"`([^`]+)`", re.sub(r"(?ms)^```.*?^```", "", text)) + re.findall(
        r"(?ms)^```\w*\n(.*?)^```", text
    )
    lines = [" ".join(line.split("#")[0].split()) for block in quoted for line in block.splitlines()]
    named = {found.groups() for line in lines if (found := COMMAND.search(line)) and "import" not in line}
    groups = {"insitu": insitu, "surrogate": surrogate, "catalogs": catalogs}
    assert sorted(pair for pair in named if pair[1] not in groups[pair[0]].commands) == []


@every_document
def test_make_targets_that_are_named_exist(document: Path) -> None:
    rules = re.findall(r"^([a-z-]+):", (PROJECT / "Makefile").read_text(), re.MULTILINE)
    quoted = re.findall(r"`[^`\n]*`|^(?:\$ )?make .*$", document.read_text(), re.MULTILINE)
    named = {word for text in quoted for words in TARGET.findall(text) for word in words.split()}
    assert sorted(named - set(rules)) == []


def test_the_readme_is_short_and_says_nothing_of_a_commit() -> None:
    text = (PROJECT / "README.md").read_text()
    assert len(text.split()) <= 700
    assert text.count("\n") <= 110
    assert re.findall(r"±|\bcommit\b|\b[0-9a-f]{7,12}\b|AMD|EPYC|Intel|Xeon", text) == []


def test_every_page_is_three_clicks_from_the_readme() -> None:
    clicks, rest = {DOCUMENTS[0]: 0}, [DOCUMENTS[0]]
    for page in rest:
        linked = [unquote(link.split("#")[0]) for link in LINK.findall(page.read_text()) if "://" not in link]
        for target in ((page.parent / link).resolve() for link in linked if link.endswith(".md")):
            if target not in clicks:
                clicks[target] = clicks[page] + 1
                rest.append(target)
    home = PROJECT / "docs" / "index.md"  # of the site, which README links around
    pages = [path for path in DOCUMENTS if path.is_relative_to(PROJECT / "docs") and path.suffix == ".md"]
    assert [str(page) for page in pages if page != home and clicks.get(page, 4) > 3] == []


def test_pages_outside_results_stay_few() -> None:
    """At most half of what all pages had before there were parts."""
    pages = [path for path in DOCUMENTS if path.suffix == ".md" and (PROJECT / "docs") in path.parents]
    apart = [path for path in pages if "results" not in path.relative_to(PROJECT).parts]
    assert sum(path.stat().st_size for path in apart) <= 112_000


def test_how_to_pages_fit_a_screen() -> None:
    pages = [
        path for path in (PROJECT / "docs" / "how-to").glob("*.md") if path.stem not in ("index", "extend", "questions")
    ]
    assert {path.name: lines for path in pages if (lines := path.read_text().count("\n")) > 50} == {}


def test_every_example_of_the_gallery_is_linked_from_a_how_to_page() -> None:
    text = "".join(path.read_text() for path in (PROJECT / "docs" / "how-to").glob("*.md"))
    linked = set(re.findall(r"\]\(\.\./gallery/(plot_\w+)\)", text))
    assert linked == {path.stem for path in (PROJECT / "examples" / "gallery").glob("plot_*.py")}


def test_questions_are_answered_by_pages() -> None:
    rows = re.findall(r"^\| (?!---|\.\.\.).* \|$", (PROJECT / "docs" / "how-to" / "index.md").read_text(), re.MULTILINE)
    assert len(rows) >= 40
    assert [row for row in rows if "](" not in row] == []
