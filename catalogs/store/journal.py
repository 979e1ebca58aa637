"""The journal of a growing catalog: a hidden file with a line per member, derived from the members and checked before use.

It answers in constant time which member has given parameters, and whether `data.csv` is up to date.  A line holds a checksum over
all lines so far, a digest of a member's parameters, and its name.  The last line of a commit also holds the stamps of the table and
of the members' folder.  Where the last stamps differ from those on disk, the journal is rebuilt from the members: a writer was
killed between two steps, or somebody removed a member by hand.  It is never synced: after a power cut it does not match and is
rebuilt.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from catalogs.files import durable
from catalogs.files.durable import Stamp


def key_of(parameters: Mapping[str, float]) -> str:
    """32 hexadecimal digits, the same for equal values in the same order, and for no others."""
    text = ",".join(repr(float(value) + 0.0) for value in parameters.values())  # + 0.0: minus zero equals zero
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Stamps:
    """State of a catalog: when its folder of members last changed, and the stamp of its table."""

    members: int
    table: Stamp


@dataclass(frozen=True)
class _Contents:
    """The journal as read up to byte `end` of the file with this inode."""

    inode: int = 0
    end: int = 0
    checksum: int = 0
    names: dict[str, str] = field(default_factory=dict)
    last: Stamps | None = None
    table_before: Stamp | None = None

    def damaged(self) -> _Contents:
        """The same without stamps: nothing of it is believed."""
        return replace(self, inode=0, last=None)


class Journal:
    """The journal in the file `path`; each reading takes in only new lines."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._contents = _Contents()

    @property
    def names(self) -> Mapping[str, str]:
        """The members' names by the keys of their parameters, as of the last reading."""
        return self._contents.names

    @property
    def table_before(self) -> Stamp | None:
        """The stamp of the table before the last commit."""
        return self._contents.table_before

    def read(self) -> Stamps | None:
        """Read lines that were appended; returns the last line's stamps, None where the journal is absent or damaged."""
        try:
            with durable.opened(self._path) as stream:
                inode = os.fstat(stream.fileno()).st_ino
                if inode == self._contents.inode:
                    stream.seek(self._contents.end)
                    self._contents = _extended(self._contents, stream.read())
                    if self._contents.last is not None:
                        return self._contents.last
                    stream.seek(0)  # replaced by another file with the same inode
                self._contents = _extended(_Contents(inode=inode), stream.read())
        except OSError:
            self._contents = _Contents()
        return self._contents.last

    def append(self, members: Sequence[tuple[str, str]], stamps: Stamps) -> None:
        """Append a commit, (key, name) of one or more members, to a journal that was read to its end.

        Does nothing where the disk refuses.  Only the last line has stamps: without it, the lines before are not believed.
        """
        *first, last = members
        data = _lines(self._contents.checksum, first, (*last, stamps))
        with contextlib.suppress(OSError):
            durable.append(self._path, data)
            self._contents = _extended(self._contents, data)

    def write(self, members: Iterable[tuple[str, str]], stamps: Stamps) -> None:
        """Replace the journal by one of all members, (key, name), and the present stamps; does nothing where the disk refuses."""
        partial = durable.partial_name(self._path)
        try:
            durable.write(partial, _lines(0, members, ("-", "-", stamps)))
            durable.rename(partial, self._path)
        except OSError:
            partial.unlink(missing_ok=True)
        self.read()


def _lines(checksum: int, members: Iterable[tuple[str, str]], last: tuple[str, str, Stamps]) -> bytes:
    key, name, stamps = last
    bodies = [*(f"{k} {n}" for k, n in members), " ".join(map(str, [key, name, stamps.members, *stamps.table]))]
    lines = []
    for body in bodies:
        lines.append(f"{zlib.crc32(body.encode(), checksum):08x} {body}\n".encode())
        checksum = zlib.crc32(lines[-1], checksum)
    return b"".join(lines)


def _extended(contents: _Contents, data: bytes) -> _Contents:
    """The journal with further lines; without stamps where they are damaged."""
    names, checksum, last, before = contents.names, contents.checksum, contents.last, contents.table_before
    for line in data.splitlines(keepends=True):
        written, _, body = line.rstrip(b"\n").partition(b" ")
        if not line.endswith(b"\n") or written != b"%08x" % zlib.crc32(body, checksum):
            return contents.damaged()
        key, name, *numbers = body.decode(errors="replace").split(" ") if body.count(b" ") in (1, 5) else ("", "")
        if name != "-":
            names[key] = name
        if numbers:
            if not all(number.isdecimal() for number in numbers):
                return contents.damaged()
            stamps = Stamps(int(numbers[0]), Stamp(*map(int, numbers[1:])))
            before = last.table if last is not None and last.table != stamps.table else before
            last = stamps
        checksum = zlib.crc32(line, checksum)
    return _Contents(contents.inode, contents.end + len(data), checksum, names, last, before)
