"""The library's functions on numbers and arrays of Python; each returns a status, and keeps the error's text."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from numpy.typing import NDArray

from catalogs.vocabulary import numbers
from catalogs.vocabulary.appearance import shown_fields
from catalogs.vocabulary.scene import Scene
from catalogs.vocabulary.words import joined_names
from insitu.fields.share import ghost_layers
from insitu.hook.session import Session
from insitu.members.planning import PlanOptions
from insitu.mpi.ranks import SINGLE, RankGroup, all_or_none, ranks_of

DONE, FAILED, UNKNOWN = 0, 1, -1
LARGEST = 1 << 40  # samples: more is a mistake in a shape
SETTERS = {
    "set_parameter": "parameter",
    "set_grid": "grid",
    "set_ghosts": "ghosts",
    "set_field": "field",
    "copy_field": "field",
}


class LibraryCalls:
    """The state between the calls of one simulation: its session, and what it has said of the next member.

    A call that fails changes nothing.  On ranks it may fail on one alone: the next render then fails on all, unless the same
    function was called again and succeeded.
    """

    def __init__(self) -> None:
        self.error = ""
        self._begin_anew(None, SINGLE)

    def _begin_anew(self, session: Session | None, ranks: RankGroup) -> None:
        self._session, self._ranks = session, ranks
        self._parameters: dict[str, float] = {}
        self._fields: dict[str, NDArray[Any]] = {}
        self._place: dict[str, Any] = {}
        self._refused: dict[str, BaseException] = {}  # by what was to be set, on ranks

    def initialize(self, scene: str, catalog: str, comm: Any = None) -> int:
        """Begin; `comm` is a communicator of mpi4py."""

        def begin() -> int:
            ranks = ranks_of(comm)

            def load() -> Scene:
                if self._session is not None:
                    raise ValueError("insitu_initialize was called twice: call insitu_finalize before")
                for what, path in (("scene", scene), ("catalog", catalog)):
                    if not path:
                        raise ValueError(f"{what} must be a path, got NULL or an empty text")
                return Scene.load(scene)

            loaded = all_or_none(ranks, load)
            options = all_or_none(ranks, lambda: vars(PlanOptions.of_scene(loaded, loaded.space)))
            session = Session(catalog, comm=comm, existing="skip", warn=_warn, **options)
            self._begin_anew(session, ranks)
            self._space, self._field_names = loaded.space, shown_fields(loaded.appearances)
            return DONE

        return self._try(begin, FAILED)

    def set_parameter(self, name: str, value: float) -> int:
        """See insitu.h."""

        def take() -> None:
            others = {parameter.name: parameter.low for parameter in self._space.parameters}
            self._space.values({**others, name: value}, outside="allow")
            self._parameters[name] = value

        return self._set("set_parameter", take)

    def set_grid(self, spacing: Sequence[float], origin: Sequence[float]) -> int:
        """See insitu.h."""

        def take() -> None:
            steps = tuple(numbers.positive(step, "spacing") for step in spacing)
            self._place |= {"spacing": steps, "origin": numbers.row(origin, 3, "origin")}

        return self._set("set_grid", take)

    def set_ghosts(self, layers: Sequence[int]) -> int:
        """See insitu.h."""

        def take() -> None:
            ghost_layers(tuple(layers))
            if any(layers) and self._ranks is SINGLE:
                raise ValueError(
                    f"layers {tuple(layers)} are of a rank's block, but the session has one process: begin it by "
                    "insitu_initialize_mpi, or leave them out of the field (insitu_copy_field)"
                )
            self._place["ghosts"] = tuple(layers)

        return self._set("set_ghosts", take)

    def set_field(self, name: str, shape: Sequence[int], values: Callable[[int], NDArray[Any]]) -> int:
        """`values` makes the flat array of that many numbers; `shape` is of (x, y, z)."""

        def take() -> None:
            self._check_field(name, tuple(shape))
            self._fields[name] = values(math.prod(shape)).reshape(tuple(shape)[::-1])

        return self._set("set_field", take)

    def render(self, time: float) -> int:
        """See insitu.h."""

        def draw() -> int:
            session = self._initialized_session()
            fields: Any = self._fields if self._fields.keys() - {""} else self._fields.get("")
            refused = next(iter(self._refused.values()), None)
            if fields is None and self._ranks is SINGLE:
                refused = TypeError("the member has no field: call insitu_set_field before insitu_render")
            try:
                field = fields if refused is None else partial(_fail, refused)
                session.render_member(field, dict(self._parameters), time=_time(time), **self._place)
            finally:
                self._fields, self._refused = {}, {}
            return DONE

        return self._try(draw, FAILED)

    def has(self, time: float) -> int:
        """See insitu.h."""
        return self._try(
            lambda: int(self._initialized_session().has(dict(self._parameters), time=_time(time))), UNKNOWN
        )

    def finalize(self) -> int:
        """See insitu.h."""

        def end() -> int:
            session = self._initialized_session()
            self._begin_anew(None, SINGLE)
            session.close()
            return DONE

        return self._try(end, FAILED)

    def refuse(self, error: BaseException, failed: int = FAILED, function: str = "") -> int:
        """Keep the text of an error of a function; returns the status `failed`."""
        if self._ranks is not SINGLE and function in SETTERS:
            self._refused[SETTERS[function]] = error
        self.error = f"{type(error).__name__}: {error}"
        return failed

    def _check_field(self, name: str, shape: tuple[int, ...]) -> None:
        least = 2 if self._ranks is SINGLE else 1
        if min(shape) < 1 or math.prod(shape) > LARGEST:
            raise ValueError(f"field {name!r}: shape must be three positive numbers (x, y, z), got {shape}")
        if min(shape) < least:
            raise ValueError(f"field {name!r}: shape must be at least 2 samples along x, y and z, got {shape}")
        named = self._field_names not in ((), ("",))
        if named and name not in self._field_names:
            raise ValueError(
                f"field {name!r} is shown by no appearance of the scene: they show {joined_names(self._field_names)}"
            )
        for other, values in self._fields.items():
            if other != name and not named:
                raise ValueError(
                    f"field {name!r} is the member's second, after {other!r}, but no appearance names the field that it shows: "
                    'set one alone, or give every [[appearance]] its field = "..."'
                )
            if other != name and values.shape[::-1] != shape:
                raise ValueError(
                    f"field {name!r} has the shape {shape}, but {other!r} {values.shape[::-1]}: the fields of a member share one"
                )

    def _initialized_session(self) -> Session:
        if self._session is None:
            raise ValueError("insitu_initialize must be called, and succeed, before")
        return self._session

    def _set(self, function: str, take: Callable[[], None]) -> int:
        def work() -> int:
            self._initialized_session()
            take()
            self._refused.pop(SETTERS[function], None)
            return DONE

        return self._try(work, FAILED, function)

    def _try(self, work: Callable[[], int], failed: int, function: str = "") -> int:
        try:
            result, self.error = work(), ""
        except Exception as error:
            return self.refuse(error, failed, function)
        return result


def _fail(error: BaseException) -> None:
    raise error


def _time(time: float) -> float | None:
    return None if math.isnan(time) else time


def _warn(note: Warning) -> None:
    """Warnings go to standard error: there is no line of Python to name."""
    with suppress(AttributeError, OSError, ValueError):  # the program may have closed it
        sys.stderr.write(warnings.formatwarning(note, type(note), "insitu", 0).split(": ", 1)[-1])
