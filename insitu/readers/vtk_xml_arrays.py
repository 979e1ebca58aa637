"""The arrays of one of VTK's XML files, compared with what it says of them before VTK reads it.

VTK believes the sizes in front of binary arrays.  It takes the next array's bytes where some were lost, and a number of blocks
that asks for too much memory ends the process.

Source: VTK's description of its XML formats, "Appended data" and "Binary".
"""

from __future__ import annotations

import base64
import binascii
import math
import mmap
import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from insitu.readers.arrays import check_room

TAG = re.compile(rb"<!--.*?-->|<(/?)([A-Za-z]\w*)((?:[^>\"']|\"[^\"]*\"|'[^']*')*)>", re.DOTALL)
ATTRIBUTE = re.compile(rb"(\w+)\s*=\s*[\"']([^\"']*)[\"']")
WIDTHS = {f"{kind}{bits}": bits // 8 for kind in ("Int", "UInt") for bits in (8, 16, 32, 64)} | {
    "Float32": 4,
    "Float64": 8,
}
APPENDED = "AppendedData"  # element
BLANK = b" \t\r\n"
CELLS = ("NumberOfCells", "NumberOfVerts", "NumberOfLines", "NumberOfStrips", "NumberOfPolys")
FEW = 64  # blanks that may stand behind raw data
SLICE = 1 << 24  # bytes of text that are counted at once

Attributes = Mapping[str, str]


@dataclass(frozen=True)
class _Layout:
    """Storage of numbers in a file: its bytes, the type of sizes, and where appended data begin (-1: nowhere).

    `ends` are the places at which the arrays behind begin, and the last one's end, in order.
    """

    data: mmap.mmap
    size: np.dtype[np.unsignedinteger]
    is_compressed: bool
    start: int
    ends: tuple[int, ...]
    is_raw: bool

    def lengths(self, place: int, end: int, is_raw: bool) -> tuple[int, int]:
        """Bytes of the array at a place, unpacked, and bytes that it takes in the file until `end`, in base64 or raw."""
        width = self.size.itemsize
        counts = self._sizes(place, end, 3 if self.is_compressed else 1, is_raw)
        if not self.is_compressed:
            return counts[0], width + counts[0] if is_raw else _text_bytes(width + counts[0])
        blocks, full, last = counts
        if blocks == 0:
            return 0, 0
        if blocks * width > end - place:
            raise ValueError(f"claims {blocks} blocks, more than the file has bytes for")
        header = (3 + blocks) * width
        packed = sum(self._sizes(place, end, 3 + blocks, is_raw)[3:])
        check_room(full, "a block of it")
        length = header + packed if is_raw else _text_bytes(header) + _text_bytes(packed)
        return full * (blocks - bool(last)) + last, length

    def fills(self, place: int, end: int, is_raw: bool, claim: int | None = None) -> bool:
        """True if the array at a place ends where the next one begins, but for blanks; with `claim` bytes, unpacked."""
        try:
            claimed, length = self.lengths(place, end, is_raw)
        except ValueError:
            return False
        if is_raw:
            rest = end - place - length
            return claim in (None, claimed) and 0 <= rest <= FEW and not self.data[end - rest : end].strip(BLANK)
        text = end - place
        if length != text:
            text = len(self.data[place:end].translate(None, BLANK))
        return claim in (None, claimed) and length == text

    def _sizes(self, place: int, end: int, count: int, is_raw: bool) -> list[int]:
        """The first sizes in front of an array."""
        wanted = count * self.size.itemsize
        header = self.data[place : min(end, place + (wanted if is_raw else 2 * _text_bytes(wanted)))]
        if not is_raw:
            try:  # of lines, maybe
                header = base64.b64decode(header.translate(None, BLANK)[: _text_bytes(wanted)], validate=True)
            except binascii.Error as error:
                raise ValueError(f"is not base64: {error}") from None
        if len(header) < wanted:
            raise ValueError("begins where the file ends")
        return [int(size) for size in np.frombuffer(header[:wanted], self.size)]


def check_arrays(path: Path) -> None:
    """Raise ValueError where an array has not the bytes that it claims, or claims others than its data set has values."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        begin, ends, is_raw = _appended(data)
        layout: _Layout | None = None
        piece: Attributes = {}
        sections: list[str] = []
        whole = covered = 0
        for closing, name, said, place in _tags(data):
            if name == "VTKFile" and not closing:
                layout = _layout(data, said, begin, ends, is_raw)
            elif name == "Piece" and not closing:
                piece = said
                covered += _cells(said.get("Extent", ""))[1]
            elif name == "DataArray" and not closing and layout is not None:
                try:
                    _check(layout, said, place, _values(said, piece, sections))
                except ValueError as error:
                    raise ValueError(f"array {said.get('Name', '')!r} {error}") from None
            elif name != "DataArray":
                whole = whole or _cells(said.get("WholeExtent", ""))[1]
                sections = [s for s in sections if s != name] if closing else [*sections, name]
                if closing and name == "Piece":
                    piece = {}
    if covered < whole:
        raise ValueError(f"its pieces have {covered} of the {whole} cells in its WholeExtent: is a piece missing?")


def _tags(data: mmap.mmap) -> Iterator[tuple[bool, str, Attributes, int]]:
    """Of each tag to where appended data begin: true if it closes an element, the name, the attributes, and where it ends."""
    place = data.find(b"<")
    while place >= 0:
        match = TAG.match(data, place)
        if match is not None and match[2] is not None:
            name, is_closing = match[2].decode(), bool(match[1])
            said = {key.decode(): value.decode("utf-8", "replace") for key, value in ATTRIBUTE.findall(match[3])}
            yield is_closing, name, said, match.end()
            if name == APPENDED:
                return
            if match[3].rstrip().endswith(b"/"):
                yield True, name, {}, match.end()
        place = data.find(b"<", place + 1 if match is None else match.end())


def _appended(data: mmap.mmap) -> tuple[int, tuple[int, ...], bool]:
    """The place of appended data, -1 without any, the places at which their arrays begin, their end, and true if they are raw."""
    offsets: set[int] = set()
    for _, name, said, place in _tags(data):
        if name == APPENDED:
            start, end = data.find(b"_", place) + 1, data.rfind(f"</{APPENDED}".encode())
            return start, (*sorted(start + offset for offset in offsets), end), said.get("encoding") == "raw"
        if name == "DataArray" and said.get("format") == "appended":
            offsets.add(int(said.get("offset", 0)))
    return -1, (), False


def _layout(data: mmap.mmap, said: Attributes, start: int, ends: tuple[int, ...], is_raw: bool) -> _Layout:
    order = ">" if said.get("byte_order", "") == "BigEndian" else "<"
    size = np.dtype(f"{order}u{8 if said.get('header_type') == 'UInt64' else 4}")
    return _Layout(data, size, bool(said.get("compressor")), start, ends, is_raw)


def _values(said: Attributes, piece: Attributes, sections: list[str]) -> int | None:
    """The numbers that an array must have; None where nothing says so."""
    section = sections[-1] if sections else ""
    components = int(said.get("NumberOfComponents") or 1)
    if section == "FieldData":
        return components * int(said["NumberOfTuples"]) if said.get("NumberOfTuples") else None
    if "NumberOfPoints" in piece:
        points, count = int(piece["NumberOfPoints"]), sum(int(piece.get(name) or 0) for name in CELLS)
    elif "Extent" in piece:
        points, count = _cells(piece["Extent"])
    else:
        return None
    return {"PointData": components * points, "Points": 3 * points, "CellData": components * count}.get(section)


def _cells(extent: str) -> tuple[int, int]:
    """Points and cells of an extent "x0 x1 y0 y1 z0 z1", none of one that is empty."""
    numbers = [int(number) for number in extent.split()]
    steps = [high - low for low, high in zip(numbers[::2], numbers[1::2], strict=True)]
    if len(steps) != 3 or min(steps) < 0:
        return 0, 0
    return math.prod(n + 1 for n in steps), math.prod(max(1, n) for n in steps)


def _check(layout: _Layout, said: Attributes, place: int, values: int | None) -> None:
    kind, width = said.get("format", "ascii"), WIDTHS.get(said.get("type", ""))
    needed = None if values is None or width is None else values * width
    if kind == "appended":
        place, is_raw = layout.start + int(said.get("offset", 0)), layout.is_raw
        if layout.start <= 0 or layout.ends[-1] < 0 or not layout.start <= place <= layout.ends[-1]:
            raise ValueError("is appended where the file has no data: was it cut short?")
        end = layout.ends[min(bisect_right(layout.ends, place), len(layout.ends) - 1)]
    else:
        place, end, is_raw = _stripped(layout.data, place)
        if kind == "ascii":
            if needed is not None and width and (count := _words(layout.data, place, end)) != values:
                raise ValueError(f"has {count} values, its data set {values}: was it cut short?")
            return
    if needed == 0 or (place == end and needed is None):
        return
    claimed, length = layout.lengths(place, end, is_raw)
    if needed is not None and claimed != needed:
        raise ValueError(f"claims {claimed} bytes, its data set has values for {needed}: was it damaged?")
    check_room(claimed, "it")
    if length > end - place:
        raise ValueError(f"takes {length} bytes, the file has {end - place} for it: was it cut short?")
    other = replace(layout, size=np.dtype(f"{layout.size.byteorder}u{12 - layout.size.itemsize}"))
    if not layout.fills(place, end, is_raw) and other.fills(place, end, is_raw, needed):
        bits = 8 * other.size.itemsize
        raise ValueError(f"has its size in {bits} bits, and header_type says otherwise: set it to UInt{bits}")


def _stripped(data: mmap.mmap, place: int) -> tuple[int, int, bool]:
    """Begin and end of the text of an element that begins at a place, without the blanks around it; not raw."""
    end = data.find(b"<", place)
    end = len(data) if end < 0 else end
    while place < end and data[place] in BLANK:
        place += 1
    while end > place and data[end - 1] in BLANK:
        end -= 1
    return place, end, False


def _words(data: mmap.mmap, place: int, end: int) -> int:
    """The number of words in a text."""
    count, before = 0, True
    for start in range(place, end, SLICE):
        blank = np.frombuffer(data[start : min(end, start + SLICE)], np.uint8) <= ord(" ")
        count += int(np.count_nonzero(blank[:-1] & ~blank[1:])) + int(before and not blank[0])
        before = bool(blank[-1])
    return count


def _text_bytes(count: int) -> int:
    """Characters of as many bytes in base64."""
    return 4 * math.ceil(count / 3)
