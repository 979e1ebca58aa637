"""The reference: every public name has a page and an example, and examples give what they say.

Examples run in an empty folder beside `examples/gallery`, whose run of two blobs they share, as its scripts do.
"""

from __future__ import annotations

import doctest
import inspect
import re
import shutil
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent
GALLERY = PROJECT / "examples" / "gallery"
PACKAGES = ("insitu", "render", "catalogs", "surrogate", "native.ray_casting", "surrogate.emulation")
MODULES = ("insitu.bindings.trigger", "insitu.bindings.blueprint")
OTHERS = (
    "surrogate.ray_casting.volume_image",
    "surrogate.model.differentiable.DifferentiableSurrogate",
    "surrogate.evaluation.perceptual.PerceptualMetrics",
)
NAMES = [f"{package}.{name}" for package in PACKAGES for name in import_module(package).__all__]
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
MOST_LINES = 12  # of an example


def object_of(name: str) -> object:
    package, _, attribute = name.rpartition(".")
    return getattr(import_module(package), attribute)


def listed_names() -> dict[str, str]:
    """The names that the reference's page lists, with the module that it has each from."""
    names, module, inside = dict[str, str](), "", False
    for line in (PROJECT / "docs" / "reference" / "api.md").read_text(encoding="utf-8").splitlines():
        inside = (inside or line.startswith("```{eval-rst}")) and line != "```"
        if inside and line.startswith(".. currentmodule:: "):
            module = line.split()[-1]
        elif inside and re.fullmatch(r" +\w+", line):
            names[line.strip()] = module
    return names


@pytest.fixture(scope="module")
def gallery() -> Iterator[None]:
    """Its scripts can be imported, by worker processes as well."""
    sys.path.insert(0, str(GALLERY))
    yield
    sys.path.remove(str(GALLERY))


def test_the_reference_lists_every_public_name_and_no_other() -> None:
    public = {name.rpartition(".")[2] for name in NAMES}
    listed = listed_names()
    assert sorted(public ^ set(listed)) == []
    assert [name for name, module in listed.items() if f"{module}.{name}" not in NAMES] == []


@pytest.mark.parametrize("name", [*NAMES, *OTHERS])
def test_a_public_name_has_a_short_example_that_runs_everywhere(name: str) -> None:
    text = inspect.getdoc(object_of(name)) or ""
    examples = doctest.DocTestParser().get_examples(text)
    assert examples, f"{name} has no example"
    assert "+SKIP" not in text
    assert sum(example.source.count("\n") for example in examples) <= MOST_LINES


@pytest.mark.slow
@pytest.mark.usefixtures("gallery")
@pytest.mark.parametrize("name", [*NAMES, *OTHERS, *MODULES])
@pytest.mark.filterwarnings("error")
def test_an_example_gives_what_it_says(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(GALLERY / "vortex.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    text = inspect.getdoc(import_module(name) if name in MODULES else object_of(name)) or ""
    said: list[str] = []
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    failed, tried = doctest.DocTestRunner(optionflags=FLAGS).run(test, out=said.append)
    assert tried > 0
    assert failed == 0, "".join(said)
