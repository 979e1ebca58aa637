"""The protocol of readers: how one knows a simulation code's files, what these say of themselves, how it reads a field."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.engines.stopping import StopRequested
from catalogs.vocabulary.words import joined_names
from insitu.readers.arrays import Arrays

INTERPOLATIONS = ("nearest", "linear")


@dataclass(frozen=True)
class Sampling:
    """The resampling of data that lie on no one regular grid.

    Attributes
    ----------
    resolution : values along (x, y, z); None: as many as the reader chooses.
    interpolation : "nearest", the value of the cell that contains a point, or "linear" between cell centres.
    mesh : the file that holds the mesh, where those with the fields don't.
    """

    resolution: tuple[int, int, int] | None = None
    interpolation: str = "nearest"
    mesh: Path | None = None

    def __post_init__(self) -> None:
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(f"interpolation must be one of {joined_names(INTERPOLATIONS)}, got {self.interpolation!r}")
        if self.resolution is not None and (len(self.resolution) != 3 or min(self.resolution) < 2):
            raise ValueError(f"resolution must be three numbers from 2 up (x, y, z), got {self.resolution}")

    @property
    def identity(self) -> dict[str, Any]:
        """The values that differ from the defaults, in JSON values."""
        settings = {
            "resolution": self.resolution and list(self.resolution),
            "interpolation": self.interpolation if self.interpolation != "nearest" else None,
            "mesh": self.mesh and self.mesh.name,
        }
        return {key: value for key, value in settings.items() if value}


@dataclass(frozen=True)
class StoredState:
    """One state of the simulation in a file.

    Attributes
    ----------
    index : where it lies in the file.
    says : the numbers that the file says of it, by name.  Of those that tell states apart equally well, such as redshift and time,
        the first is the parameter.
    arrays : names of the arrays that it has, where the states of a file differ in them; None: all.
    """

    index: tuple[int, ...] = ()
    says: Mapping[str, float] = field(default_factory=dict)
    arrays: frozenset[str] | None = None

    def lacks(self, arrays: Sequence[str]) -> bool:
        """True if it has not all of `arrays`, which are paths or their last names, or () for any one."""
        if self.arrays is None:
            return False
        names = self.arrays | {name.rpartition("/")[2] for name in self.arrays}
        return not names.issuperset(arrays) or not names


@dataclass(frozen=True, eq=False)
class Reader:
    """The reader of one code's files.

    Another package adds a reader by an entry point that names a `Reader`, in its pyproject.toml:

        [project.entry-points."gs_surrogate.readers"]
        mycode = "my_package.reader:READER"

    `insitu ensemble`, `watch` and `probe` then take `--reader mycode`, and recognize its files:

        READER = Reader("mycode", "MyCode, .my files", lambda path: path.suffix == ".my", records, read)

    Attributes
    ----------
    name : the value of `--reader`.
    what : the files, in a few words.
    recognizes : true for a file, or a folder that counts as one, that is surely the code's; looks at little of it and raises
        nothing.
    records : (path, sampling) to the states in a file; raises ValueError or OSError.
    read : (path, array, index of a state, sampling) to a field as `render.to_grid` takes it, such as `insitu.Field`; `array` None
        stands for the only one.  Raises ValueError, OSError, or ModuleNotFoundError that names the extra to install.
    opens : in place of `read`: the arrays of a file, whose first axes are those of a state's index.
    files : path to all files that hold what is read there, the one that stands for all of them first.
    marks : names of files by which, together, a folder is one dump and counts as a file.
    grows : states are added to a file that has some, which leaves those as they are.
    samples : it takes a `Sampling` that is not the default.
    units : of the numbers that states say, by name.
    """

    name: str
    what: str
    recognizes: Callable[[Path], bool]
    records: Callable[[Path, Sampling], Sequence[StoredState]]
    read: Callable[[Path, str | None, tuple[int, ...], Sampling], Any] | None = None
    opens: Callable[[Path], AbstractContextManager[Arrays]] | None = None
    files: Callable[[Path], Sequence[Path]] = lambda path: (path,)
    marks: tuple[str, ...] = ()
    grows: bool = False
    samples: bool = False
    units: Mapping[str, str] = field(default_factory=dict)

    @contextmanager
    def reading(self, path: Path) -> Iterator[None]:
        """Turns what a reader should not raise into ValueError that names it; ValueError, OSError and ImportError pass."""
        try:
            yield
        except (ValueError, OSError, ImportError, StopRequested):
            raise
        except Exception as error:
            raise ValueError(
                f"{path}: the reader {self.name!r} failed: {type(error).__name__}: {' '.join(str(error).split())}"
            ) from error

    def states(self, path: Path, sampling: Sampling) -> list[StoredState]:
        """The states in a file, at least one; raises ValueError where the reader gives something else."""
        with self.reading(path):
            states = list(self.records(path, sampling))
        if not states:
            raise ValueError(f"{path}: the reader {self.name!r} finds no state in it")
        for state in states:
            if not isinstance(state, StoredState):
                raise ValueError(
                    f"{path}: the reader {self.name!r} finds {type(state).__name__} in place of a StoredState"
                )
            for name, value in state.says.items():
                if not isinstance(value, int | float | np.number) or not math.isfinite(value):
                    raise ValueError(f"{path}: its {name} must be a finite number, got {value!r}")
        return states


def chosen_array(array: str | None, names: Sequence[str], what: str = "the file") -> str:
    """The array that is asked for, or the only one; raises ValueError listing them."""
    if array is None and len(names) == 1:
        return names[0]
    if array is None:
        raise ValueError(f"name the array to render (--array): {what} has {', '.join(names) or 'none'}")
    if array not in names:
        raise ValueError(f"no array {array!r}: {what} has {', '.join(names) or 'none'}")
    return array
