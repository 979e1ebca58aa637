"""The simulation codes whose output is read as it is, and the one that wrote a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from catalogs import plugins
from insitu.readers import adios, amrex, athena, cloverleaf, mpas, openpmd, stores, the_well, vtk_files, xcompact3d
from insitu.readers.reader import Reader

OURS: tuple[Reader, ...] = (
    adios.READER,
    amrex.READER,
    athena.READER,
    cloverleaf.READER,
    mpas.READER,
    openpmd.READER,
    stores.READER,
    the_well.READER,
    xcompact3d.READER,
    vtk_files.READER,
)


def readers() -> tuple[Reader, ...]:
    """Our readers, and those of other packages (see `Reader`)."""
    return _joined(tuple(plugins.plugins(plugins.READERS).items()))


@lru_cache
def _joined(plugged: tuple[tuple[str, object], ...]) -> tuple[Reader, ...]:
    joined = {reader.name: reader for reader in OURS}
    for name, reader in plugged:
        if not isinstance(reader, Reader):
            problem = f"its type is {type(reader).__name__}, not insitu.readers.reader.Reader"
        elif reader.name in joined:
            problem = f"there is a reader {reader.name!r} already"
        else:
            joined[reader.name] = replace(reader, recognizes=_Recognition(name, reader.recognizes))
            continue
        plugins.leave_out(name, plugins.package_of(name, plugins.READERS), plugins.READERS, problem)
    joined[vtk_files.READER.name] = joined.pop(vtk_files.READER.name)  # whose formats others' files may be of, too
    return tuple(joined.values())


@dataclass
class _Recognition:
    """The recognition of files by another package's reader: false for all once it has failed, which is said then."""

    name: str
    recognizes: Callable[[Path], bool]
    failed: bool = False

    def __call__(self, path: Path) -> bool:
        if self.failed:
            return False
        try:
            return bool(self.recognizes(path))
        except Exception as error:
            self.failed = True
            package, problem = plugins.package_of(self.name, plugins.READERS), f"{type(error).__name__}: {error}"
            plugins.leave_out(
                self.name,
                package,
                plugins.READERS,
                f"its recognizes failed for {path}: {problem}; --reader names it still",
            )
            return False


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
