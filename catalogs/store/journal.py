"""What a growing catalog remembers of its commits: a hidden file with a line for each member, derived and never trusted unseen.

It answers in no time which member has some parameters, and whether `data.csv` is what the members make.  A line holds a member's
name and a digest of its parameters; the last one of a commit also the stamps that the table and the members' folder had after it; a
checksum that covers all lines before it stands first.  Where the last stamps are not those on disk (a writer was killed between two
steps, somebody removed a member by hand), the journal is out of date and is written anew from the members.
It is never synced: what a power cut leaves of it does not match and is not believed.
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
    """32 hexadecimal digits that are the same for equal values in the same order, and for no others."""
    text = ",".join(repr(float(value) + 0.0) for value in parameters.values())  # + 0.0: minus zero equals zero
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Stamps:
    """What tells one state of a catalog from all others: when its members last changed, and which file is its table."""

    members: int
    table: Stamp


@dataclass(frozen=True)
class _Read:
    """What was read so far, up to `end`, of the file with this inode."""

    inode: int = 0
    end: int = 0
    checksum: int = 0
    names: dict[str, str] = field(default_factory=dict)
    last: Stamps | None = None
    table_before: Stamp | None = None


class Journal:
    """The journal in the file `path`, of which each reading takes in only what is new."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = _Read()

    @property
    def names(self) -> Mapping[str, str]:
        """The members' names by the keys of their parameters, as of the last reading."""
        return self._read.names

    @property
    def table_before(self) -> Stamp | None:
        """The stamp of the table before the last one."""
        return self._read.table_before

    def read(self) -> Stamps | None:
        """Take in what was appended; returns the last line's stamps, None where there is no whole journal."""
        try:
            with durable.opened(self._path) as stream:
                known, inode = self._read, os.fstat(stream.fileno()).st_ino
                if inode == known.inode:
                    stream.seek(known.end)
                    self._read = _taken_in(known, stream.read())
                    if self._read.last is not None:
                        return self._read.last
                    stream.seek(0)  # replaced by another file with the same inode
                self._read = _taken_in(_Read(inode=inode), stream.read())
        except OSError:
            self._read = _Read()
        return self._read.last

    def append(self, members: Sequence[tuple[str, str]], stamps: Stamps) -> None:
        """Add a commit of (key, name) of one or more members to a journal that was read to its end.

        Does nothing where the disk refuses.  Only the last line has stamps: without it, what stands before is not believed.
        """
        lines, checksum = [], self._read.checksum
        for number, (key, name) in enumerate(members, start=1):
            lines.append(_line(checksum, key, name, stamps if number == len(members) else None))
            checksum = zlib.crc32(lines[-1], checksum)
        with contextlib.suppress(OSError):
            durable.append(self._path, b"".join(lines))
            self._read = _taken_in(self._read, b"".join(lines))

    def write(self, members: Iterable[tuple[str, str]], stamps: Stamps) -> None:
        """Replace the journal: (key, name) of every member, and the stamps that they have now."""
        lines, checksum = [], 0
        for key, name in members:
            lines.append(_line(checksum, key, name))
            checksum = zlib.crc32(lines[-1], checksum)
        lines.append(_line(checksum, "-", "-", stamps))
        partial = durable.partial_name(self._path)
        try:
            durable.write(partial, b"".join(lines))
            durable.rename(partial, self._path)
        except OSError:
            partial.unlink(missing_ok=True)
        self.read()


def _line(checksum: int, key: str, name: str, stamps: Stamps | None = None) -> bytes:
    numbers = [] if stamps is None else [stamps.members, *stamps.table]
    body = " ".join(map(str, [key, name, *numbers]))
    return f"{zlib.crc32(body.encode(), checksum):08x} {body}\n".encode()


def _taken_in(known: _Read, data: bytes) -> _Read:
    """What is known after `data`; without stamps where that is damaged."""
    names, checksum, last, before = known.names, known.checksum, known.last, known.table_before
    for line in data.splitlines(keepends=True):
        written, _, body = line.rstrip(b"\n").partition(b" ")
        key, name, *numbers = body.decode(errors="replace").split(" ") if body.count(b" ") in (1, 5) else ("", "")
        if not line.endswith(b"\n") or written != b"%08x" % zlib.crc32(body, checksum):
            return replace(known, inode=0, last=None)
        if name != "-":
            names[key] = name
        if numbers:
            if not all(number.isdecimal() for number in numbers):
                return replace(known, inode=0, last=None)
            stamps = Stamps(int(numbers[0]), Stamp(*map(int, numbers[1:])))
            before = last.table if last is not None and last.table != stamps.table else before
            last = stamps
        checksum = zlib.crc32(line, checksum)
    return _Read(known.inode, known.end + len(data), checksum, names, last, before)
