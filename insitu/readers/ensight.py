"""EnSight Gold files walked through before VTK reads them: its files do not say how long they are, and VTK believes any end.

Of text that was cut short VTK draws what its memory holds, and a header without its numbers ends the process.  Files of other
kinds, in Fortran's records, or with several times each are not walked through.

Source: EnSight User Manual, "EnSight Gold casefile format".
"""

from __future__ import annotations

import math
import mmap
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

LINE = 80  # bytes of words in binary files
NODES = {"point": 1, "bar2": 2, "bar3": 3, "tria3": 3, "tria6": 6, "quad4": 4, "quad8": 8, "tetra4": 4, "tetra10": 10}
NODES |= {"pyramid5": 5, "pyramid13": 13, "penta6": 6, "penta15": 15, "hexa8": 8, "hexa20": 20}
COMPONENTS = {"scalar": 1, "vector": 3, "tensor symm": 6, "tensor asym": 9}
VARIABLE = re.compile(r"(scalar|vector|tensor symm|tensor asym) per (node|element):\s*(.+)")
CUT = "it ends within part {}: was it cut short?"

Counts = Mapping[tuple[int, str], tuple[int, int]]  # by part and section, of its nodes and its elements


class _Unwalked(Exception):
    """A file that says something else than what is known here."""


class _Cursor(Protocol):
    """A place in a file, which words and numbers move on; they raise EOFError behind the end."""

    def is_done(self) -> bool: ...
    def words(self) -> str: ...
    def integers(self, count: int) -> list[int]:
        """The next whole numbers, which text has on one line."""
        ...

    def skip(self, count: int, lines: int) -> None:
        """Pass `count` numbers, which text has on `lines` lines."""
        ...


class _Text:
    def __init__(self, data: bytes | mmap.mmap) -> None:
        self.data, self.number = data, 0
        self.ends = [*np.flatnonzero(np.frombuffer(data, np.uint8) == ord("\n")).tolist()]
        begin = self.ends[-1] + 1 if self.ends else 0
        before = self._line(len(self.ends) - 1) if self.ends else b""
        if len(data[begin:].rstrip()) >= len(before.rstrip()):  # else its last number may have lost digits
            self.ends.append(len(data))

    def is_done(self) -> bool:
        return not self.data[(end := self.ends[self.number - 1]) : end + LINE].strip()

    def _line(self, number: int) -> bytes:
        return self.data[self.ends[number - 1] + 1 if number else 0 : self.ends[number]]

    def words(self) -> str:
        self.skip(1, 1)
        return self._line(self.number - 1).decode("latin-1").strip()

    def integers(self, count: int) -> list[int]:
        return list(map(int, self.words().split()))[:count]

    def skip(self, count: int, lines: int) -> None:
        self.number += lines
        if self.number > len(self.ends):
            raise EOFError


class _Binary:
    def __init__(self, data: bytes | mmap.mmap) -> None:
        self.data, self.place, self.order = data, 0, ""

    def is_done(self) -> bool:
        return self.place >= len(self.data)

    def words(self) -> str:
        self._move(LINE)
        return self.data[self.place - LINE : self.place].split(b"\0")[0].decode("latin-1").strip()

    def integers(self, count: int) -> list[int]:
        self._move(4 * count)
        data = self.data[self.place - 4 * count : self.place]
        if not self.order:  # the first is the number of a part
            self.order = min("<>", key=lambda order: int(np.frombuffer(data, f"{order}u4")[0]))
        return np.frombuffer(data, f"{self.order}i4").tolist()

    def skip(self, count: int, lines: int) -> None:
        self._move(4 * count)

    def _move(self, count: int) -> None:
        self.place += count
        if self.place > len(self.data):
            raise EOFError


def check_case(path: Path, text: str) -> None:
    """Raise ValueError where a file that the case `text` names, the first of several times, ends too early."""
    lines = [line.strip() for line in text.splitlines()]
    models = [line.split(":")[1].split() for line in lines if line.lower().startswith("model:")]
    if not re.search(r"type:\s*ensight gold", text, re.IGNORECASE) or not models:
        return
    try:
        geometry = next(_named(path, word) for word in models[0] if not word.isdigit())
        counts = _geometry(geometry)
        for match in filter(None, map(VARIABLE.match, lines)):
            _variable(_named(path, match[3].split()[-1]), match[1], match[2] == "element", counts)
    except _Unwalked:
        return


def _named(path: Path, name: str) -> Path:
    files = sorted(path.parent.glob(re.sub(r"\*+", "[0-9]*", name))) if "*" in name else [path.parent / name]
    if not files or not files[0].is_file():
        raise ValueError(f"there is no file {name}, which it names")
    return files[0]


def _content(path: Path) -> bytes | mmap.mmap:
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b""


def _geometry(path: Path) -> Counts:
    data = _content(path)
    is_binary = data[:8] == b"C Binary"
    if b"\0" in data[:LINE] and not is_binary:
        raise _Unwalked
    cursor: _Cursor = _Binary(data) if is_binary else _Text(data)
    part, sections = 0, dict[tuple[int, str], tuple[int, int]]()
    try:
        _begin(cursor, is_binary)
        cursor.words()
        ids = [cursor.words().split()[-1] in ("given", "ignore") for _ in range(2)]
        while not cursor.is_done():
            section = cursor.words()
            if section == "part":
                part = cursor.integers(1)[0]
                cursor.words()
            elif section.startswith("extents"):
                cursor.skip(6, 3)
            else:
                sections[part, section.split()[0]] = _section(cursor, section, ids)
    except EOFError:
        raise ValueError(f"{path.name}: {CUT.format(part)}") from None
    except (IndexError, ValueError):
        raise _Unwalked from None
    if not sections:
        raise ValueError(f"{path.name}: {CUT.format(part)}")
    return sections


def _begin(cursor: _Cursor, is_binary: bool) -> None:
    if is_binary:
        cursor.words()
    if cursor.words().upper().startswith("BEGIN TIME STEP"):
        raise _Unwalked


def _section(cursor: _Cursor, words: str, ids: list[bool]) -> tuple[int, int]:
    """Pass a section of geometry; returns its numbers of nodes and elements."""
    if cursor.is_done():
        raise EOFError
    kind, *options = words.split()
    if kind == "block":
        if set(options) - {"rectilinear", "uniform", "curvilinear", "iblanked"}:
            raise _Unwalked
        sizes = cursor.integers(3)
        count = math.prod(sizes)
        values = 6 if "uniform" in options else sum(sizes) if "rectilinear" in options else 3 * count
        cursor.skip(values, values)
        if "iblanked" in options:
            cursor.skip(count, count)
        return count, math.prod(max(1, size - 1) for size in sizes)
    if kind != "coordinates" and kind not in NODES:
        raise _Unwalked
    count = cursor.integers(1)[0]
    if ids[kind != "coordinates"]:
        cursor.skip(count, count)
    cursor.skip(count * NODES.get(kind, 3), 3 * count if kind == "coordinates" else count)
    return count, count


def _variable(path: Path, kind: str, of_elements: bool, counts: Counts) -> None:
    data, part = _content(path), 0
    cursor: _Cursor = _Binary(data) if b"\0" in data[: 2 * LINE + 4] else _Text(data)
    try:
        _begin(cursor, False)
        while not cursor.is_done():
            section = cursor.words()
            if section == "part":
                part = cursor.integers(1)[0]
                continue
            if cursor.is_done():
                raise EOFError
            values = COMPONENTS[kind] * counts[part, section][of_elements]
            cursor.skip(values, values)
    except EOFError:
        raise ValueError(f"{path.name}: {CUT.format(part)}") from None
    except (IndexError, ValueError, KeyError):
        raise _Unwalked from None
    if not part:
        raise ValueError(f"{path.name}: {CUT.format(part)}")
