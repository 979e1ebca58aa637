"""Files of folders that come from others: read only where they are what they should be, and never more than is expected."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def opened_inside(folder: Path, name: str, most: int) -> Iterator[tuple[BinaryIO, int]]:
    """The regular file `name` in `folder`, to be read, and its size in bytes.

    Raises OSError as `open` does.  Raises ValueError for a link that leads out of the folder, for devices and pipes (which could
    wait for ever), and for a file of more than `most` bytes.
    """
    real = os.path.realpath(folder / name)
    if os.path.dirname(real) != os.path.realpath(folder):
        raise ValueError(f"{name} is a link that leads out of its folder, to {real}: copy the file itself there")
    descriptor = os.open(real, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW)
    with open(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise ValueError(f"{name} is not a regular file")
        if status.st_size > most:
            raise ValueError(f"{name} has {status.st_size:,} bytes, more than the {most:,} that such a file may have")
        yield file, status.st_size
