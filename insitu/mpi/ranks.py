"""The processes of one simulation, which render its members together.

Rank 0 leads: it alone runs what needs no block, and tells the others what to do with theirs.  Every exchange carries errors, too:
what one rank could not do ends the same command on all, so that none waits for another for ever.
"""

from __future__ import annotations

import math
import os
import pickle
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

BUILTIN = (ValueError, TypeError, OSError, MemoryError)  # errors of these types keep them on all ranks
T = TypeVar("T")
ROUNDING = 1e-6  # relative difference of numbers that are one: some go through single precision
LONGEST_PART = 1 << 30  # bytes sent in one call: some MPI libraries count in 32 bits


class RankError(RuntimeError):
    """An error on another rank that is not one of Python's usual ones."""


class CollectiveError(Exception):
    """An error that every rank knows of; `error` is what its caller is to get."""

    def __init__(self, error: Exception) -> None:
        super().__init__(str(error))
        self.error = error


class RankGroup(Protocol):
    """Processes that call the same things in the same order."""

    @property
    def number(self) -> int:
        """Of this process, from 0."""

    @property
    def size(self) -> int:
        """The number of ranks."""

    def gather(self, value: Any) -> list[Any]:
        """The values of all ranks, on all of them, in their order.  Raises CollectiveError where one of them failed."""

    def send(self, parts: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        """Bytes for each rank, in their order; returns those from each.  Raises CollectiveError where one of them failed."""

    def fail(self, error: Exception) -> None:
        """Take part in the next exchange with an error."""


class SingleProcess:
    """One process that has the whole field."""

    number, size = 0, 1

    def gather(self, value: Any) -> list[Any]:
        """The value."""
        return [value]

    def send(self, parts: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        """The bytes."""
        return list(parts)

    def fail(self, error: Exception) -> None:
        """Nobody else is to know."""


SINGLE = SingleProcess()


class Communicator:
    """The ranks of an MPI communicator of mpi4py, used by blocking collective calls only."""

    def __init__(self, comm: Any) -> None:
        self._comm = checked(comm)
        self.number, self.size = int(comm.Get_rank()), int(comm.Get_size())

    def gather(self, value: Any) -> list[Any]:
        """See `RankGroup`."""
        return self._exchange((None, value))

    def fail(self, error: Exception) -> None:
        """See `RankGroup`."""
        try:
            self._exchange((_portable(error), None))
        except CollectiveError:
            return

    def send(self, parts: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        """See `RankGroup`."""
        sizes = [part.size for part in parts]
        table = np.array(self.gather(sizes))  # [size, size], from and to
        received = [np.empty(n, dtype=np.uint8) for n in table[:, self.number]]
        share = LONGEST_PART // self.size
        for start in range(0, int(table.max(initial=0)), share):
            out = [part[start : start + share] for part in parts]
            into = [part[start : start + share] for part in received]
            self._send_once(out, into)
        return received

    def _send_once(self, parts: Sequence[NDArray[np.uint8]], into: Sequence[NDArray[np.uint8]]) -> None:
        joined = np.concatenate(parts)
        counts, arriving = [part.size for part in parts], [part.size for part in into]
        arrived = np.empty(sum(arriving), dtype=np.uint8)
        self._comm.Alltoallv([joined, (counts, _starts(counts))], [arrived, (arriving, _starts(arriving))])
        for part, start in zip(into, _starts(arriving), strict=True):
            part[:] = arrived[start : start + part.size]

    def _exchange(self, message: tuple[Exception | None, Any]) -> list[Any]:
        messages = self._comm.allgather(message)
        failed = [(rank, error) for rank, (error, _) in enumerate(messages) if error is not None]
        if failed:
            raise CollectiveError(_named(failed, self.size))
        return [value for _, value in messages]


def ranks_of(comm: Any) -> RankGroup:
    """The ranks of an mpi4py communicator, or of none; raises TypeError or ValueError for anything else.

    Those that share cores share them for drawing, too, unless LP_NUM_THREADS says otherwise.
    """
    if comm is None:
        return SINGLE
    ranks = Communicator(comm)
    os.environ.setdefault("LP_NUM_THREADS", str(rendering_threads(ranks)))
    return ranks


def checked(comm: Any) -> Any:
    """`comm`; raises TypeError unless it looks like one of mpi4py's, ValueError where it joins two groups."""
    if not all(hasattr(comm, name) for name in ("allgather", "Alltoallv", "Get_rank", "Get_size")):
        raise TypeError(
            f"comm must be a communicator of mpi4py, such as MPI.COMM_WORLD, got {type(comm).__name__}; "
            "from a handle of C or Fortran MPI.Comm.f2py makes one"
        )
    if comm.Is_inter():
        raise ValueError("comm joins two groups of ranks (an inter-communicator): pass one of a single group")
    return comm


def all_or_none(ranks: RankGroup, work: Callable[[], T]) -> T:
    """The result of `work` on this rank; an error on one rank is raised on all, in the same words."""
    if ranks.size == 1:
        return work()
    try:
        result = work()
    except Exception as error:
        failed: Exception | None = error
    else:
        failed = None
    errors = ranks.gather(None if failed is None else _portable(failed))
    named = [(rank, error) for rank, error in enumerate(errors) if error is not None]
    if named:
        raise _named(named, ranks.size) from failed
    return result


def disagreement(ranks: RankGroup, said: Mapping[str, Any]) -> str:
    """A sentence on the first value by name that two ranks give differently, "" where they agree.  Collective.

    A rank that leaves a name out agrees with all.  Numbers may differ by rounding.
    """
    first: dict[str, tuple[int, Any]] = {}
    for rank, others in enumerate(ranks.gather({name: _plain(value) for name, value in said.items()})):
        for name, value in others.items():
            other, expected = first.setdefault(name, (rank, value))
            if not _same(expected, value):
                return (
                    f"rank {other} gives {name} = {expected!r}, rank {rank} {value!r}: all ranks render one member together, "
                    "so give the same on all"
                )
    return ""


def _plain(value: Any) -> Any:
    """A value that can be sent and compared: numbers as float, other objects in words."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, Sequence):
        return [_plain(one) for one in value]
    try:
        return float(value)
    except Exception:
        return repr(value)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_same(one[name], other[name]) for name in one)
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=ROUNDING, abs_tol=1e-12) or (one != one and other != other)
    return bool(one == other)


def run_on_root(
    ranks: RankGroup, work: Callable[[], Any], commands: Mapping[str, Callable[..., Any]] | None = None
) -> Any:
    """The result or error of `work` on rank 0, on every rank; the others meanwhile run the `commands` that it calls.

    `call_all` sends them.
    """
    if ranks.size == 1:
        return work()
    if ranks.number:
        return _obey_root(ranks, commands or {})
    try:
        result = work()
    except Exception as error:
        _announce(ranks, "raised", _portable(error))
        raise
    _announce(ranks, "returned", result)
    return result


def call_all(ranks: RankGroup, commands: Mapping[str, Callable[..., Any]], name: str, *arguments: Any) -> Any:
    """Let every rank run a command; for rank 0 within `run_on_root`, whose own result is returned.

    Raises what one of them raised.
    """
    try:
        ranks.gather((name, arguments))
        return _run(ranks, commands[name], arguments)
    except CollectiveError as collective:
        raise collective.error from None


def _announce(ranks: RankGroup, outcome: str, value: Any) -> None:
    """Let the others return.  One that fails just now, when all is decided, gets the same outcome."""
    with suppress(CollectiveError):
        ranks.gather((outcome, value))
        return
    _announce(ranks, outcome, value)


def _obey_root(ranks: RankGroup, commands: Mapping[str, Callable[..., Any]]) -> Any:
    while True:
        try:
            name, arguments = ranks.gather(None)[0]
            if name == "returned":
                return arguments
            if name == "raised":
                raise arguments
            _run(ranks, commands[name], arguments)
        except CollectiveError:  # rank 0 knows, and says what comes of it
            continue


def _run(ranks: RankGroup, command: Callable[..., Any], arguments: Sequence[Any]) -> Any:
    """The result of a command; an error on this rank reaches the others."""
    try:
        return command(*arguments)
    except CollectiveError:
        raise
    except Exception as error:
        ranks.fail(error)
        raise CollectiveError(_named([(ranks.number, error)], ranks.size)) from error


def rendering_threads(ranks: RankGroup) -> int:
    """Cores for each of the ranks that share this one's."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    here = (socket.gethostname(), cores)
    return max(1, len(cores) // ranks.gather(here).count(here))


def _named(failed: Sequence[tuple[int, Exception]], size: int) -> Exception:
    """One error for all: the first rank's, and how many others have some."""
    rank, error = failed[0]
    others = f" ({len(failed) - 1} more ranks failed)" if len(failed) > 1 else ""
    text = f"rank {rank} of {size}: {error}{others}" if size > 1 else str(error)
    kind = next((kind for kind in BUILTIN if isinstance(error, kind)), RankError)
    if kind is RankError:
        text = f"{type(error).__name__}: {text}"
    named = kind(text)
    if isinstance(error, OSError) and isinstance(named, OSError):
        named.errno = error.errno
    return named


def _portable(error: Exception) -> Exception:
    """`error`, or what can be sent of it."""
    try:
        same = pickle.loads(pickle.dumps(error))
        return error if type(same) is type(error) and str(same) == str(error) else RankError(_text(error))
    except Exception:
        return RankError(_text(error))


def _text(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _starts(counts: Sequence[int]) -> list[int]:
    return [0, *np.cumsum(counts)[:-1].tolist()]
