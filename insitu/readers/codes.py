"""The simulation codes whose output is read as it is, and which of them wrote a file."""

from __future__ import annotations

from pathlib import Path

from insitu.readers import adios, amrex, cloverleaf, mpas, the_well, xcompact3d
from insitu.readers.reader import Reader

READERS: tuple[Reader, ...] = (
    adios.READER,
    amrex.READER,
    cloverleaf.READER,
    mpas.READER,
    the_well.READER,
    xcompact3d.READER,
)


def reader_named(name: str) -> Reader:
    """The reader of this name; raises ValueError listing all."""
    for reader in READERS:
        if reader.name == name:
            return reader
    raise ValueError(f"there is no reader {name!r}, there are {listed_readers()}")


def reader_of(path: Path, name: str = "") -> Reader | None:
    """The reader of this name, else the one that surely reads a file; None where the file is of a general format, or unknown."""
    if name:
        return reader_named(name)
    return next((reader for reader in READERS if reader.recognizes(path)), None)


def listed_readers() -> str:
    """All readers with what they read, in one line."""
    return "; ".join(f"{reader.name} ({reader.what})" for reader in READERS)
