"""Folders that count as one file, and the files below a folder."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from insitu.readers.arrays import ZARR
from insitu.readers.codes import readers


def is_folder_file(path: Path) -> bool:
    """True for a folder that counts as one file: a Zarr store, or a dump of a code such as an AMReX plotfile."""
    if not path.is_dir():
        return False
    marked = (reader.marks for reader in readers() if reader.marks)
    return path.suffix in ZARR or any(all((path / name).exists() for name in names) for names in marked)


def files_below(base: Path, *, deep: bool = True) -> list[Path]:
    """All files below a folder, and folders that count as one, by path with numbers in their order; hidden ones are left out.

    Not `deep`: only those that lie in the folder itself.
    """
    return sorted(_walk(base, deep), key=lambda path: natural(path.as_posix()))


def _walk(base: Path, deep: bool) -> Iterator[Path]:
    for folder, folders, files in os.walk(base):
        visible = [name for name in folders if not name.startswith(".")]
        whole = [name for name in visible if is_folder_file(Path(folder, name))]
        yield from (Path(folder, name) for name in [*files, *whole] if not name.startswith("."))
        folders[:] = [name for name in visible if name not in whole] if deep else []


def natural(text: str) -> list[tuple[int, str]]:
    """A key that sorts text by its words, and the numbers in it by their value."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", text)]
