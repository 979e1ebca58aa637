"""The identity of a stored field: the contents of its file, so that another file is not taken for it."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

BLOCK = 1 << 20  # bytes
BLOCKS = 256  # read at most: what is larger is known by as many blocks, evenly spread from the first to the last
# Files that hold little but the names of others; these count as well.
INDEXES = {
    ".case",
    ".encas",
    ".mhd",
    ".nhdr",
    ".pvd",
    ".pvti",
    ".pvtr",
    ".pvts",
    ".pvtu",
    ".series",
    ".vthb",
    ".vtm",
    ".vtmb",
    ".vtpc",
    ".vtpd",
    ".xdmf",
    ".xmf",
    ".xdmf3",
}
LONGEST_INDEX = 1 << 22


def contents(path: str | os.PathLike[str], *, beside: Sequence[Path] = ()) -> dict[str, Any]:
    """The identity of the contents of a file, or of a folder such as a Zarr store, in JSON values.

    `size` (bytes), `modified` (nanoseconds since 1970, of the newest file) and `sha256`, over names, sizes and all bytes of
    up to 256 MB, else over 256 blocks.  Of files such as .pvtu, which name others beside them, these are a part; so are files
    `beside` that belong to it.
    """
    parts = list(_parts(Path(path), beside))
    digest = hashlib.sha256()
    sizes = [part.stat().st_size for _, part in parts]
    for (name, _), size in zip(parts, sizes, strict=True):
        digest.update(f"{name}\0{size}\0".encode())
    few = sum(sizes) > BLOCK * BLOCKS
    read = sorted({len(parts) * i // BLOCKS for i in range(BLOCKS)} if few else range(len(parts)))
    for number in read:
        for block in _blocks(parts[number][1], max(1, BLOCKS // len(read)) if few else 0):
            digest.update(block)
    return {**stamp(path, beside=beside), "sha256": digest.hexdigest()}


def stamp(path: str | os.PathLike[str], *, beside: Sequence[Path] = ()) -> dict[str, int]:
    """Size and time of change, as in `contents`, without reading."""
    states = [part.stat() for _, part in _parts(Path(path), beside)]
    return {"size": sum(s.st_size for s in states), "modified": max((s.st_mtime_ns for s in states), default=0)}


def is_changed(path: str | os.PathLike[str], before: Mapping[str, Any], *, beside: Sequence[Path] = ()) -> bool:
    """True if a file holds something else than when `before` was its `contents`; read only if its size or time say so."""
    now = stamp(path, beside=beside)
    if now["size"] != before.get("size"):
        return True
    return now["modified"] != before.get("modified") and contents(path, beside=beside)["sha256"] != before.get("sha256")


def _parts(path: Path, beside: Sequence[Path] = ()) -> Iterator[tuple[str, Path]]:
    """The files that count as one, each with its name below the folder."""
    yield from ((other.name, other) for other in beside)
    if path.is_dir():
        files = sorted(Path(folder, name) for folder, _, names in os.walk(path) for name in names)
        yield from ((file.relative_to(path).as_posix(), file) for file in files if file.is_file())
        return
    yield "", path
    if path.suffix.lower() in INDEXES and path.stat().st_size <= LONGEST_INDEX:
        text, folder = path.read_text(encoding="utf-8", errors="replace"), path.resolve().parent
        for name in sorted(set(re.findall(r"[^\s\"'<>:=]+\.\w+", text))):
            other = folder / name
            if other.is_file() and other.resolve().is_relative_to(folder) and other != path.resolve():
                yield name, other


def _blocks(path: Path, count: int) -> Iterator[bytes]:
    """`count` blocks of a file, evenly spread from the first to the last; all of it for 0, or where it has no more."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if not count or size <= BLOCK * count:
            while block := file.read(BLOCK):
                yield block
            return
        for number in range(count):
            file.seek((size - BLOCK) * number // max(1, count - 1))
            yield file.read(BLOCK)
