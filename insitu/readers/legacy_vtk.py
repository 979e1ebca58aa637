"""The lengths that a legacy VTK file (.vtk) claims, against its own: VTK's reader takes an array that is cut short for whole.

Source: "VTK File Formats", Simple Legacy Formats, and VTK's vtkDataReader.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

SIZES = {  # bytes of a binary value; vtkIdType is stored as int
    **dict.fromkeys(("char", "unsigned_char", "signed_char", "vtktypeint8", "vtktypeuint8"), 1),
    **dict.fromkeys(("short", "unsigned_short", "vtktypeint16", "vtktypeuint16"), 2),
    **dict.fromkeys(("int", "unsigned_int", "float", "vtkidtype", "vtktypeint32", "vtktypeuint32"), 4),
    **dict.fromkeys(("long", "unsigned_long", "double", "vtktypeint64", "vtktypeuint64"), 8),
}
COMPONENTS = {
    "vectors": 3,
    "normals": 3,
    "tensors": 9,
    "tensors6": 6,
    "global_ids": 1,
    "pedigree_ids": 1,
    "edge_flags": 1,
}
CELLS = ("cells", "vertices", "lines", "polygons", "triangle_strips")
PLACE = ("dataset", "dimensions", "extent", "origin", "spacing", "aspect_ratio")
BLOCK = 1 << 22
LINE = 1 << 12  # bytes: longer than any keyword


class _UnknownPart(Exception):
    """Something that this check does not know the length of, and VTK may."""


@dataclass
class _Cursor:
    """A place in a file that is read from its start."""

    data: mmap.mmap
    is_binary: bool = False
    at: int = 0

    def line(self) -> list[str]:
        """The words of the next line that has any; [] at the end of the file."""
        while self.at < len(self.data):
            end = self.data.find(b"\n", self.at, self.at + LINE)
            if end < 0 and len(self.data) > self.at + LINE:
                raise _UnknownPart
            line = self.data[self.at : end if end >= 0 else len(self.data)]
            self.at = end + 1 if end >= 0 else len(self.data)
            if words := line.decode("latin-1").split():
                return words
        return []

    def skip(self, count: int, kind: str, what: str) -> None:
        """Go behind values; raises ValueError where the file has not as many."""
        size = (count + 7) // 8 if kind == "bit" else count * SIZES.get(kind, 0)
        if not size and count and kind != "bit":
            raise _UnknownPart
        available = min(size, len(self.data) - self.at) if self.is_binary else self._words(count)
        if self.is_binary:
            self.at += available
        if available < (size if self.is_binary else count):
            claimed = f"{size} bytes" if self.is_binary else f"{count} values"
            raise ValueError(f"{what} claims {claimed}, and the file ends after {available}: was it cut short?")

    def _words(self, count: int) -> int:
        """Go behind as many words; the number that there are."""
        left = count
        while left and self.at < len(self.data):
            block = np.frombuffer(self.data[self.at : self.at + BLOCK], np.uint8) > ord(" ")
            ends = np.flatnonzero(block[:-1] & ~block[1:]) + 1  # of words that end within the block
            if len(ends) >= left:
                self.at += int(ends[left - 1])
                return count
            if self.at + len(block) == len(self.data):
                self.at = len(self.data)
                return count - left + len(ends) + bool(block[-1])
            if not len(ends):
                raise _UnknownPart
            left -= len(ends)
            self.at += int(ends[-1])
        return count - left


def check_legacy(path: Path) -> None:
    """Raise ValueError where a legacy VTK file is shorter than it says; of parts of unknown length nothing is said."""
    if not path.stat().st_size:
        raise ValueError("it is empty")
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        cursor = _Cursor(data)
        try:
            head = data[:LINE].split(b"\n", 3)
            if len(head) < 4 or not head[0].startswith(b"# vtk DataFile"):
                raise ValueError(
                    "it does not begin as a VTK file does: '# vtk DataFile Version', a title, ASCII or BINARY"
                )
            cursor.is_binary = head[2].strip().upper() == b"BINARY"
            cursor.at = sum(len(line) + 1 for line in head[:3])
            for _ in _parts(cursor):
                pass
        except (_UnknownPart, IndexError):
            return


def _parts(cursor: _Cursor) -> Iterator[None]:
    """Go through the parts of a file."""
    count = 0  # points or cells of the arrays
    while words := [word.lower() for word in cursor.line()]:
        key, rest = words[0], words[1:]
        try:
            if key in PLACE:
                continue
            if key in ("point_data", "cell_data"):
                count = int(rest[0])
            elif key in ("x_coordinates", "y_coordinates", "z_coordinates"):
                cursor.skip(int(rest[0]), rest[1], key)
            elif key == "points":
                cursor.skip(3 * int(rest[0]), rest[1], key)
            elif key == "cell_types":
                cursor.skip(int(rest[0]), "int", key)
            elif key in CELLS:
                _cells(cursor, key, int(rest[0]), int(rest[1]))
            elif key == "field":
                _field(cursor, int(rest[-1]))
            elif key == "metadata":
                _metadata(cursor)
            else:
                _array(cursor, key, rest, count)
        except ValueError as error:
            if str(error).startswith("invalid literal"):
                raise _UnknownPart from None
            raise
        yield


def _cells(cursor: _Cursor, key: str, first: int, second: int) -> None:
    """Cells as numbers of points, or since version 5 as their offsets and points."""
    before = cursor.at
    words = [word.lower() for word in cursor.line()]
    if words[:1] != ["offsets"]:
        cursor.at = before
        cursor.skip(second, "int", key)
        return
    cursor.skip(first, words[1], f"offsets of {key}")
    words = [word.lower() for word in cursor.line()]
    if words[:1] != ["connectivity"]:
        raise ValueError(f"{key} lacks its connectivity: was it cut short?")
    cursor.skip(second, words[1], f"connectivity of {key}")


def _field(cursor: _Cursor, arrays: int) -> None:
    for number in range(arrays):
        words = cursor.line()
        if words and words[0].lower() == "metadata":
            _metadata(cursor)
            words = cursor.line()
        if not words:
            raise ValueError(f"it claims a field of {arrays} arrays, and ends after {number}: was it cut short?")
        cursor.skip(int(words[1]) * int(words[2]), words[3].lower(), f"array {words[0]!r}")


def _array(cursor: _Cursor, key: str, rest: list[str], count: int) -> None:
    """One of the attributes that legacy files name by what they are."""
    what = f"array {rest[0]!r}"
    if key == "scalars":
        before = cursor.at
        if [word.lower() for word in cursor.line()][:1] != ["lookup_table"]:
            cursor.at = before
        cursor.skip(count * (int(rest[2]) if len(rest) > 2 else 1), rest[1], what)
    elif key == "color_scalars":
        cursor.skip(count * int(rest[1]), "unsigned_char", what)
    elif key == "lookup_table":
        cursor.skip(4 * int(rest[1]), "unsigned_char", what)
    elif key == "texture_coordinates":
        cursor.skip(count * int(rest[1]), rest[2], what)
    elif key in COMPONENTS:
        cursor.skip(count * COMPONENTS[key], rest[1], what)
    else:
        raise _UnknownPart


def _metadata(cursor: _Cursor) -> None:
    """Go behind the lines of an array's metadata, which an empty one ends."""
    end = cursor.data.find(b"\n\n", cursor.at)
    cursor.at = len(cursor.data) if end < 0 else end + 2
