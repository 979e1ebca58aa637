"""Classic netCDF files (CDF-1, CDF-2 and CDF-5, which only the netCDF library reads), their headers checked before it sees them.

"The NetCDF Classic Format Specification" (Unidata, appendix B of the NetCDF Users Guide) and that of CDF-5 (PnetCDF).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

MAGIC = b"CDF"
DIMENSIONS, VARIABLES, ATTRIBUTES = 0x0A, 0x0B, 0x0C
SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}  # bytes of a value by nc_type
LARGEST = 1 << 28  # bytes of a header


@dataclass(frozen=True)
class ClassicHeader:
    """Lengths of the dimensions, of the unlimited one as many as there are records, and the variables' dimensions, by name.

    `version` is 1, 2 or 5, the last byte of the file's mark.
    """

    dimensions: dict[str, int]
    variables: dict[str, tuple[str, ...]]
    version: int = 1


def is_classic(path: Path) -> bool:
    """True if a file is a classic netCDF file, by its first bytes; raises nothing."""
    try:
        with path.open("rb") as file:
            head = file.read(4)
    except OSError:
        return False
    return head[:3] == MAGIC and head[3:] in (b"\1", b"\2", b"\5")


def read_header(path: Path) -> ClassicHeader:
    """The header of a classic netCDF file; raises ValueError where it claims what the file cannot hold."""
    size = path.stat().st_size
    with path.open("rb") as file:
        return _header(_Words(file, min(size, LARGEST)), size)


class _Words:
    """The big-endian words of a header; raises ValueError where it ends too early."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._size = file, size
        magic = self.take(4)
        if magic[:3] != MAGIC or magic[3] not in (1, 2, 5):
            raise ValueError("it is not a classic netCDF file: it does not begin with CDF and 1, 2 or 5")
        self.version = magic[3]

    def take(self, count: int) -> bytes:
        if self._file.tell() + count > self._size:
            raise ValueError(f"its header claims {count} bytes more at byte {self._file.tell()} than the file holds")
        return self._file.read(count)

    def word(self) -> int:
        return int(struct.unpack(">I", self.take(4))[0])

    def count(self) -> int:
        """A number of things: eight bytes in CDF-5."""
        return int(struct.unpack(">Q", self.take(8))[0]) if self.version == 5 else self.word()

    def offset(self) -> int:
        return self.word() if self.version == 1 else int(struct.unpack(">Q", self.take(8))[0])

    def listed(self, tag: int, least: int) -> int:
        """The number of elements of at least `least` bytes in a list, 0 for an absent one."""
        actual, count = self.word(), self.count()
        if (actual, count) != (0, 0) and actual != tag:
            raise ValueError(f"its header has {actual:#x} at byte {self._file.tell()} where a list of {tag:#x} belongs")
        if count * least > self._size - self._file.tell():
            raise ValueError(
                f"its header claims a list of {count} elements at byte {self._file.tell()}, more than it holds"
            )
        return count

    def padded(self, count: int) -> bytes:
        return self.take(count + -count % 4)[:count]

    def name(self) -> str:
        data = self.padded(self.count())
        if not data or b"\0" in data:
            raise ValueError(
                f"its header has a name that is empty, or has a zero in it, before byte {self._file.tell()}"
            )
        return data.decode("utf-8", errors="replace")


def _header(words: _Words, size: int) -> ClassicHeader:
    streaming = (1 << (64 if words.version == 5 else 32)) - 1
    records = words.count()
    if records == streaming:
        raise ValueError("its header does not say how many records it has: is it being written?")
    lengths = [(words.name(), words.count()) for _ in range(words.listed(DIMENSIONS, 8))]
    if len({name for name, _ in lengths}) < len(lengths) or sum(not length for _, length in lengths) > 1:
        raise ValueError("its dimensions must have names, each another, and at most one be unlimited")
    _skip_attributes(words)
    variables: dict[str, tuple[str, ...]] = {}
    steps, ends = [], []  # of variables with records: bytes of a record; and where each begins and ends
    for _ in range(words.listed(VARIABLES, 16)):
        name, count = words.name(), words.count()
        if count > len(lengths):
            raise ValueError(f"its variable {name[:40]!r} claims {count} dimensions, it has {len(lengths)}")
        numbers = [words.count() for _ in range(count)]
        if name in variables or any(number >= len(lengths) for number in numbers):
            raise ValueError(f"its variable {name[:40]!r} is there twice, or on a dimension that is not there")
        _skip_attributes(words)
        kind = words.word()
        if kind not in SIZES:
            raise ValueError(f"its variable {name[:40]!r} is of no known type, {kind}")
        words.count()  # its size in bytes, which follows from the rest and is wrong in large files
        begins = words.offset()
        has_records = bool(numbers) and not lengths[numbers[0]][1]
        if any(not lengths[number][1] for number in numbers[1:]):
            raise ValueError(f"its variable {name[:40]!r} has the unlimited dimension in another place than the first")
        extent = SIZES[kind] * math.prod(lengths[number][1] for number in numbers[int(has_records) :])
        steps += [extent] if has_records else []
        ends.append((name, begins, extent, has_records))
        variables[name] = tuple(lengths[number][0] for number in numbers)
    step = steps[0] if len(steps) == 1 else sum(extent + -extent % 4 for extent in steps)
    for name, begins, extent, has_records in ends:
        end = begins + extent if not has_records else begins + (records - 1) * step + extent if records else 0
        if end > size:
            raise ValueError(
                f"its variable {name[:40]!r} ends at byte {end}, the file has {size}: is it being written?"
            )
    return ClassicHeader({name: length or records for name, length in lengths}, variables, words.version)


def _skip_attributes(words: _Words) -> None:
    for _ in range(words.listed(ATTRIBUTES, 12)):
        words.name()
        kind = words.word()
        if kind not in SIZES:
            raise ValueError(f"one of its attributes is of no known type, {kind}")
        words.padded(SIZES[kind] * words.count())
