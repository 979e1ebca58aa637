"""Command line and tables of every benchmark: tables stand between the markers of a page in docs/, with their command."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from catalogs.files import durable
from research.wrapping import wrapped
from surrogate.provenance import machine

PROJECT = Path(__file__).resolve().parents[2]
DOCS = PROJECT / "docs"
RESULTS, PICTURES = DOCS / "results", DOCS / "pictures"
CODE = ("surrogate", "catalogs", "research/benchmarks")  # folders that a surrogate's measurements depend on


def command_line(name: str, about: str | None) -> argparse.ArgumentParser:
    """The options of `python -m research.benchmarks.NAME`, whose help is `about`."""
    form = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(
        prog=f"python -m research.benchmarks.{name}", description=about, formatter_class=form
    )


def stopwatch() -> Callable[[str], None]:
    """A function that reports progress on stderr, with the seconds since now."""
    started = time.perf_counter()
    return lambda text: print(f"[{time.perf_counter() - started:5.0f} s] {text}", file=sys.stderr, flush=True)


def made_by(command: str, *folders: str, on: str = "", environment: str = "") -> str:
    """The line under a table: the command after `python -m research.benchmarks.`, the commit of `folders` and the machine."""
    called = f"`{environment}python -m research.benchmarks.{command}`"
    return f"{called}, commit {commit(*(folders or CODE))}, {on or machine()['processor']}"


def page_in(output: Path, name: str) -> Path:
    """The page `name` of docs/ in the folder `output`, initially a copy of that in docs/."""
    output.mkdir(parents=True, exist_ok=True)
    if output != RESULTS:
        durable.replace(output / name, (RESULTS / name).read_bytes())
    return output / name


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; raises ValueError for a row of another length than the header, or a cell that would break it."""
    lines = [list(header), ["---"] * len(header), *map(list, rows)]
    for line in lines:
        if len(line) != len(header):
            raise ValueError(f"a row of {len(header)} cells is needed, got {line}")
        if any("|" in cell or "\n" in cell for cell in line):
            raise ValueError(f"a cell must hold neither | nor a line break, got {line}")
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def titled(title: str, body: str) -> str:
    """A section of a page."""
    return f"### {title}\n\n{body}"


def fill(page: Path, part: str, body: str) -> None:
    """Write `body` between the markers of `part` in `page`; the rest stays as it is.

    The markers are `<!-- PART: begin -->` and `<!-- PART: end -->`, each once; raises ValueError where one is missing.
    """
    text = page.read_text(encoding="utf-8")
    begin, end = f"<!-- {part}: begin -->", f"<!-- {part}: end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ValueError(f"{page} must hold {begin} and, after it, {end}, each once")
    before, rest = text.split(begin)
    _, after = rest.split(end)
    durable.replace(page, f"{before}{begin}\n{wrapped(body.strip())}\n{end}{after}".encode())


def publish(body: str, page: Path, part: str, *, write: bool) -> None:
    """Print a part of a page, and `write` it there, if that is asked for."""
    print(body)
    if write:
        fill(page, part, body)


def commit(*folders: str) -> str:
    """The last commit that changed any of the project's `folders`, with "+dirty" where they have changed since."""
    revision = _git("log", "-1", "--format=%h", "--", *folders)
    return f"{revision}+dirty" if _git("status", "--porcelain", "--", *folders) else revision or "unknown"


def _git(*arguments: str) -> str:
    try:
        return subprocess.run(
            ["git", *arguments], cwd=PROJECT, capture_output=True, text=True, check=True
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def write_parts(page: Path, parts: Mapping[str, Callable[[], str]], made: str, say: Callable[[str], None]) -> list[str]:
    """Measure each part and write it to `page`, with the line `made` beneath, before the next begins.

    Returns the names of failed parts; their tracebacks are shown, and their text on the page stays.
    """
    failed = []
    for name, measure in parts.items():
        say(f"== {name}")
        try:
            fill(page, name, f"{measure().rstrip()}\n\n<sub>{made}</sub>")
        except Exception:
            traceback.print_exc()
            failed.append(name)
    return failed
