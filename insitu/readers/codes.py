"""The simulation codes whose output is read as it is, and the one that wrote a file."""

from __future__ import annotations

import warnings
from functools import lru_cache
from pathlib import Path

from catalogs import plugins
from insitu.readers import adios, amrex, cloverleaf, mpas, openpmd, the_well, xcompact3d
from insitu.readers.reader import Reader

OURS: tuple[Reader, ...] = (
    adios.READER,
    amrex.READER,
    cloverleaf.READER,
    mpas.READER,
    openpmd.READER,
    the_well.READER,
    xcompact3d.READER,
)


def readers() -> tuple[Reader, ...]:
    """Our readers, and those of other packages (see `Reader`)."""
    return _joined(tuple(plugins.plugins(plugins.READERS).items()))


@lru_cache
def _joined(plugged: tuple[tuple[str, object], ...]) -> tuple[Reader, ...]:
    joined = {reader.name: reader for reader in OURS}
    for name, reader in plugged:
        if not isinstance(reader, Reader):
            problem = f"it is a {type(reader).__name__}, not an insitu.readers.reader.Reader"
        elif reader.name in joined:
            problem = f"there is a reader {reader.name!r} already"
        else:
            joined[reader.name] = reader
            continue
        warnings.warn(f"{name!r} in {plugins.READERS} is left out: {problem}", stacklevel=3)
    return tuple(joined.values())


def reader_named(name: str) -> Reader:
    """The reader of this name; raises ValueError listing all."""
    for reader in readers():
        if reader.name == name:
            return reader
    raise ValueError(f"there is no reader {name!r}, there are {listed_readers()}")


def reader_of(path: Path, name: str = "") -> Reader | None:
    """The reader of this name, else the one that surely reads a file; None where the file is of a general format, or unknown."""
    if name:
        return reader_named(name)
    return next((reader for reader in readers() if reader.recognizes(path)), None)


def listed_readers() -> str:
    """All readers with what they read, in one line."""
    return "; ".join(f"{reader.name} ({reader.what})" for reader in readers())
