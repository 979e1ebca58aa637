"""Which code on which machine made a number."""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import platform
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from catalogs.version import commit

__all__ = ["code", "commit", "machine"]

PACKAGES = ("surrogate", "native", "catalogs")
# What they import decides how a model comes out.
MEASURING = ("surrogate.training.run", "surrogate.evaluation.evaluate")
SHOWING = (
    "surrogate.explore",
    "surrogate.notebook",
    "surrogate.provenance",
    "catalogs.browse",
    "catalogs.store.notebook",
    "catalogs.exchange",
    "catalogs.progress",
    "catalogs.version",
)
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


@functools.cache
def code(*also: str) -> str:
    """16 hex digits that change with the code that trains and evaluates, but not with comments, docstrings or names of modules.

    A SHA-256 over the statements of `MEASURING`, of the modules `also`, and of all modules of this project that they import,
    directly or not, without those that only show.  It covers the sources of the C++ kernels too or, where these are not
    installed, the version of the package.  Torch, other libraries and the compiler are not in it; another version of
    Python may give
    another mark.
    """
    mark = hashlib.sha256()
    for text in sorted(_statements(*also).values()):
        mark.update(f"{text}\n".encode())
    for path in sorted((_folder("native") / "kernels").glob("src/*")):
        mark.update(path.name.encode() + path.read_bytes())
    if not (_folder("native") / "kernels" / "src").is_dir():
        mark.update(importlib.metadata.version("gs-surrogate").encode())
    return mark.hexdigest()[:16]


def machine() -> dict[str, str | int]:
    """Processor, the instruction set that kernels use, cores that this process may use, and system."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    system = f"{platform.system()} {platform.machine()}"
    return {"processor": _processor(), "instructions": _instructions(), "cores": cores, "system": system}


def in_words(machine: Mapping[str, Any]) -> str:
    """A `machine` such as "AMD EPYC (avx2), 2 cores", "?" for what it does not say; earlier ones name no instruction set."""
    cores = machine.get("cores", "?")
    used = f" ({machine['instructions']})" if machine.get("instructions") else ""
    return f"{machine.get('processor', 'an unknown processor')}{used}, {cores} core{'' if cores == 1 else 's'}"


def _instructions() -> str:
    try:
        from native import kernels

        return os.environ.get("GS_SURROGATE_INSTRUCTION_SET") or kernels.instruction_sets()[0]
    except ImportError:  # the kernels were not built
        return ""


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"


def _statements(*also: str) -> dict[str, str]:
    """The code of `MEASURING`, `also` and of what they import of this project, by module.

    Comments, docstrings and imports of this project's modules are left out.
    """
    packages = {*PACKAGES, *(name.partition(".")[0] for name in also)}
    ours = re.compile(rf"\s*(from|import) ({'|'.join(sorted(packages))})\b")
    statements: dict[str, str] = {}
    files: dict[str, Path | None] = {}
    left = [*MEASURING, *also]
    while left:
        name = left.pop()
        if name in files or name.partition(".")[0] not in packages:
            continue
        files[name] = path = _file(name)
        if path is None:
            continue
        tree = ast.parse(path.read_bytes())
        left += [name.rpartition(".")[0], *_imported(tree)]
        lines = ast.unparse(_without_docstrings(tree)).splitlines()  # a statement in each
        statements[name] = "\n".join(line for line in lines if not ours.match(line))
    return statements


def _imported(tree: ast.Module) -> Iterator[str]:
    """Names that may be modules, of all imports anywhere in a module; this project has no relative ones."""
    for node in _blocks(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in _blocks(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            node.body[0] = ast.Pass()
    return tree


def _blocks(tree: ast.Module) -> Iterator[ast.AST]:
    """A module, and every statement anywhere in it; expressions, nine of ten nodes, hold neither imports nor docstrings."""
    left: list[ast.AST] = [tree]
    while left:
        node = left.pop()
        yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            left += getattr(node, part, ())


def _file(name: str) -> Path | None:
    """The source of a module of this project that does not only show; None for everything else in it."""
    package, _, rest = name.partition(".")
    if any(f"{name}.".startswith(f"{prefix}.") for prefix in SHOWING):
        return None
    path = _folder(package).joinpath(*rest.split(".")) if rest else _folder(package)
    return next((file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file()), None)


@functools.cache
def _folder(package: str) -> Path:
    """The folder of a package of this project."""
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(f"the package {package} is not installed: run `pip install gs-surrogate`")
    return Path(next(path for path in spec.submodule_search_locations if (Path(path) / "__init__.py").is_file()))
