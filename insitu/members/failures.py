"""Members that could not be rendered, where a simulation must not end for that."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

from catalogs.store.missing import no_longer_missing, report_missing
from catalogs.vocabulary.parameters import ParameterSpace
from insitu.members.request import MemberArguments, member_name, with_time
from insitu.members.result import RenderedMember


class MissingMemberWarning(UserWarning):
    """A member could not be rendered, and is missing in the catalog."""


class Failures:
    """The members of one session that are missing: in memory, and on disk as soon as there is a catalog."""

    def __init__(self, catalog: Path) -> None:
        self._catalog = catalog
        self._failures: dict[str, tuple[dict[str, Any], str]] = {}

    @property
    def reasons(self) -> dict[str, str]:
        """Why each is missing, by name."""
        return {name: reason for name, (_, reason) in self._failures.items()}

    def add(
        self, name: str, parameters: Mapping[str, Any], error: Exception, warn: Callable[[Warning], None]
    ) -> RenderedMember:
        """Take note that a member is missing, and warn of it; returns its result.  Never raises."""
        return self.report(name, parameters, f"{type(error).__name__}: {error}", warn)

    def report(
        self, name: str, parameters: Mapping[str, Any], reason: str, warn: Callable[[Warning], None]
    ) -> RenderedMember:
        """The same, and why it is missing in words."""
        self._failures[name] = dict(parameters), reason
        self.record()
        warn_safely(
            MissingMemberWarning(f"member {name} is missing: {reason}. The run goes on; render it again later"), warn
        )
        return RenderedMember(name, self._catalog, error=reason)

    def forget(self, name: str, parameters: Mapping[str, Any]) -> None:
        """Take note that a member is there after all, be it under another name."""
        self._failures = {n: failure for n, failure in self._failures.items() if n != name and failure[0] != parameters}
        no_longer_missing(self._catalog, name, parameters)

    def record(self) -> None:
        """Write into the catalog, if there is one, what is missing; a disk that refuses has no say."""
        with suppress(Exception):
            if (self._catalog / "catalog.json").is_file():
                for name, (parameters, reason) in self._failures.items():
                    report_missing(self._catalog, name, parameters, reason)


def called(member: MemberArguments, space: ParameterSpace | None) -> tuple[str, dict[str, Any]]:
    """Name and parameters as a stored member would have them, or what comes nearest to that where they are wrong."""
    mapping: Any = member.parameters
    parameters = dict(mapping) if isinstance(mapping, Mapping) else {}
    if space is not None:
        with suppress(Exception):
            parameters = dict(with_time(parameters, member.time, space)[0])
        own = {n: parameters[n] for n in space.names if n in parameters}
        parameters = {**own, **parameters}
    if isinstance(member.name, str):
        return member.name, parameters
    with suppress(Exception):
        return member_name(parameters) if parameters else "without-a-name", parameters
    return "without-a-name", parameters


def warn_caller(note: Warning) -> None:
    """Warn of `note` at the line that called into this package, however deep the call."""
    frame: FrameType | None = sys._getframe()
    level = 1
    while frame is not None and frame.f_globals.get("__name__", "").startswith("insitu."):
        frame, level = frame.f_back, level + 1
    warnings.warn(note, stacklevel=level)


def warn_safely(note: Warning, warn: Callable[[Warning], None]) -> None:
    """Warn of `note`.  Never raises."""
    try:
        warn(note)
    except Exception as refused:  # warnings that are errors, or a caller's `warn` that fails
        with suppress(Exception):
            print(f"{note} (and its warning failed: {refused!r})", file=sys.stderr)


@contextmanager
def named_disk_errors(name: str, path: Path) -> Iterator[None]:
    """Adds member and remedy to an OSError on its way out."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(
            error.errno,
            f"{error.strerror}: member {name} could not be stored and nothing of it was kept; "
            "make room or permission, then render it again",
            str(path),
        ) from error
