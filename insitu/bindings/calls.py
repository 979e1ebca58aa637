"""The library's functions on numbers and arrays of Python; each returns a status, and keeps the error's text."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Any

from numpy.typing import NDArray

from catalogs.vocabulary.scene import Scene
from insitu.hook.session import Session
from insitu.members.planning import PlanOptions

DONE, FAILED, UNKNOWN = 0, 1, -1
LARGEST = 1 << 40  # samples: more is a mistake in a shape


class LibraryCalls:
    """The state between the calls of one simulation: its session, and what it has said of the next member."""

    def __init__(self) -> None:
        self.error = ""
        self._session: Session | None = None
        self._parameters: dict[str, float] = {}
        self._fields: dict[str, NDArray[Any]] = {}
        self._place: dict[str, Any] = {}

    def initialize(self, scene: str, catalog: str, comm: Any = None) -> int:
        """Begin; `comm` is a communicator of mpi4py."""

        def begin() -> int:
            if self._session is not None:
                raise ValueError("insitu_initialize was called twice: call insitu_finalize before")
            loaded = Scene.load(scene)
            options = vars(PlanOptions.of_scene(loaded, loaded.space))
            self._session = Session(catalog, comm=comm, existing="skip", warn=_warn, **options)
            return DONE

        return self._try(begin, FAILED)

    def set_parameter(self, name: str, value: float) -> int:
        """See insitu.h."""
        self._parameters[name], self.error = value, ""
        return DONE

    def set_grid(self, spacing: Sequence[float], origin: Sequence[float]) -> int:
        """See insitu.h."""
        self._place |= {"spacing": tuple(spacing), "origin": tuple(origin)}
        self.error = ""
        return DONE

    def set_ghosts(self, layers: Sequence[int]) -> int:
        """See insitu.h."""
        self._place["ghosts"], self.error = tuple(layers), ""
        return DONE

    def set_field(self, name: str, shape: Sequence[int], values: Callable[[int], NDArray[Any]]) -> int:
        """`values` makes the flat array of that many numbers; `shape` is of (x, y, z)."""

        def take() -> int:
            count = math.prod(shape)
            if min(shape) < 1 or count > LARGEST:
                raise ValueError(f"field {name!r}: shape must be three positive numbers (x, y, z), got {tuple(shape)}")
            self._fields[name] = values(count).reshape(tuple(shape)[::-1])
            return DONE

        return self._try(take, FAILED)

    def render(self, time: float) -> int:
        """See insitu.h."""

        def draw() -> int:
            fields: Any = self._fields if self._fields.keys() - {""} else self._fields.get("")
            try:
                self._known().render_member(fields, dict(self._parameters), time=_time(time), **self._place)
            finally:
                self._fields = {}
            return DONE

        return self._try(draw, FAILED)

    def has(self, time: float) -> int:
        """See insitu.h."""
        return self._try(lambda: int(self._known().has(dict(self._parameters), time=_time(time))), UNKNOWN)

    def finalize(self) -> int:
        """See insitu.h."""

        def end() -> int:
            session, self._session = self._known(), None
            session.close()
            return DONE

        return self._try(end, FAILED)

    def _known(self) -> Session:
        if self._session is None:
            raise ValueError("insitu_initialize must be called, and succeed, before")
        return self._session

    def _try(self, work: Callable[[], int], failed: int) -> int:
        try:
            result, self.error = work(), ""
        except Exception as error:
            self.error = f"{type(error).__name__}: {error}"
            return failed
        return result


def _time(time: float) -> float | None:
    return None if math.isnan(time) else time


def _warn(note: Warning) -> None:
    """Warnings go to standard error: there is no line of Python to name."""
    sys.stderr.write(warnings.formatwarning(note, type(note), "insitu", 0).split(": ", 1)[-1])
