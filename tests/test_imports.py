"""The two halves live on different machines: each loads without the other's heavy libraries, and answers at once."""

from __future__ import annotations

import ast
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent

FORBIDDEN = {
    "catalogs": ("vtk", "vtkmodules", "pyvista", "torch"),
    "native": ("vtk", "vtkmodules", "pyvista", "torch"),
    "render": ("torch",),
    "insitu": ("torch",),
    "surrogate": ("vtk", "vtkmodules", "pyvista", "render", "insitu"),
}


@pytest.mark.slow
@pytest.mark.parametrize("package", FORBIDDEN)
def test_every_module_of_a_package_loads_without_the_other_half(package: str) -> None:
    program = (
        "import importlib, pkgutil, sys\n"
        f"package = importlib.import_module({package!r})\n"
        "for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        "    if not module.name.endswith('__main__'):\n"
        "        importlib.import_module(module.name)\n"
        f"print([name for name in {FORBIDDEN[package]!r} if name in sys.modules])\n"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=PROJECT, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip().splitlines()[-1] == "[]"


@pytest.mark.parametrize("package", ["insitu", "catalogs", "surrogate"])
def test_help_answers_within_half_a_second(package: str) -> None:
    """Of the processor: others may have it meanwhile."""
    command = [sys.executable, "-c", f"from {package}.cli import main; main()", "--help"]
    seconds = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        result = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=60)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
        assert result.returncode == 0, result.stderr
        assert "Usage" in result.stdout
    assert min(seconds) < 0.5, f"best of three took {min(seconds):.2f} s"


def test_the_packages_themselves_load_nothing_heavy() -> None:
    program = (
        "import sys, insitu, render, catalogs, surrogate, native.kernels\n"
        "print([name for name in ('torch', 'vtkmodules', 'pyvista', 'scipy', 'matplotlib') if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=PROJECT, capture_output=True, text=True, timeout=60)
    assert result.stdout.strip() == "[]", result.stdout + result.stderr


@pytest.mark.slow
def test_a_surrogate_loads_no_optimizer() -> None:
    """Which takes as long as opening a run, and serves fits alone."""
    slow = "('scipy.optimize', 'scipy.ndimage', 'sklearn')"
    program = f"import sys, surrogate.model.surrogate\nprint([name for name in {slow} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", program], cwd=PROJECT, capture_output=True, text=True, timeout=60)
    assert result.stdout.strip() == "[]", result.stdout + result.stderr


@cache
def imports_of(folder: str) -> tuple[tuple[str, str], ...]:
    """Imports of the modules below a folder, with their places, by every name that may be a module."""
    return tuple(_imports(folder))


def _imports(folder: str) -> Iterator[tuple[str, str]]:
    for path in sorted((PROJECT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                names = [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            for name in names:
                yield f"{path.relative_to(PROJECT)}:{node.lineno}", name


@pytest.mark.slow
def test_tests_share_through_support_alone() -> None:
    """A test module that imports another runs its fixtures twice, and breaks when the other moves."""
    strangers = [
        f"{place} {name}"
        for place, name in imports_of("tests")
        if name.startswith("tests.") and name.rsplit(".", 1)[-1].startswith("test_")
    ]
    assert strangers == []


def test_tests_of_the_product_know_no_research() -> None:
    found = [
        f"{place} {name}"
        for place, name in imports_of("tests")
        if not place.startswith("tests/research/") and name.startswith(("research.", "tests.research."))
    ]
    assert found == []


OURS = re.compile(r"`make |\b(scenes|docs|tests|examples)/|\.\./shared|\b(research|benchmarks)\b|CONTRIBUTING|README")


@pytest.mark.parametrize("package", FORBIDDEN)
def test_the_wheel_says_nothing_of_this_repository(package: str) -> None:
    """Whoever installed it has no Makefile, and none of our folders."""
    said = [
        f"{path.relative_to(PROJECT)}:{node.lineno} {match[0]}"
        for path in sorted((PROJECT / package).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and (match := OURS.search(node.value))
    ]
    pages = [path for kind in ("js", "html") for path in sorted((PROJECT / package).rglob(f"*.{kind}"))]
    assert said + [str(path) for path in pages if OURS.search(path.read_text())] == []
