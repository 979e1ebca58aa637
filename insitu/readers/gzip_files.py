"""Files that were packed by gzip."""

from __future__ import annotations

import gzip
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from insitu.readers.arrays import check_room


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """A temporary copy of what a .gz file holds, under its inner name; a file of another name itself.

    Raises ValueError where it holds more than the disk or the memory has room for, OSError or EOFError where it is damaged.
    """
    if path.suffix != ".gz":
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        inner = Path(folder, path.stem)
        with gzip.open(path) as packed, inner.open("wb") as file:
            room = shutil.disk_usage(folder).free
            while block := packed.read(1 << 20):
                if (room := room - len(block)) < 0:
                    raise ValueError(f"unpacked, it has no room in {folder}")
                check_room(file.tell() + len(block), "unpacked, it")
                file.write(block)
        yield inner
