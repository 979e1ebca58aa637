"""Ranks without MPI: threads of this process that meet, and programs under mpiexec."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from insitu.mpi.ranks import CollectiveError

PATIENCE = 60.0  # seconds after which ranks that wait for one another fail


class Meeting:
    """The place where the threads exchange values."""

    def __init__(self, size: int) -> None:
        self.size, self.left, self.barrier = size, [None] * size, threading.Barrier(size, timeout=PATIENCE)

    def exchange(self, number: int, value: Any) -> list[Any]:
        self.left[number] = value
        self.barrier.wait()
        found = list(self.left)
        self.barrier.wait()
        return found


class ThreadRank:
    """One of the threads, as `insitu.mpi.ranks.RankGroup`."""

    def __init__(self, meeting: Meeting, number: int) -> None:
        self.meeting, self.number, self.size = meeting, number, meeting.size

    def gather(self, value: Any) -> list[Any]:
        found = self.meeting.exchange(self.number, (None, value))
        failed = [f"rank {n}: {error}" for n, (error, _) in enumerate(found) if error is not None]
        if failed:
            raise CollectiveError(ValueError("; ".join(failed)))
        return [value for _, value in found]

    def send(self, parts: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        return [part[self.number] for part in self.gather(list(parts))]

    def fail(self, error: Exception) -> None:
        self.meeting.exchange(self.number, (error, None))


def on_ranks(size: int, work: Callable[[ThreadRank], Any]) -> list[Any]:
    """The result of `work` on each rank, or the exception that it raises there."""
    meeting = Meeting(size)

    def run(number: int) -> Any:
        try:
            return work(ThreadRank(meeting, number))
        except Exception as error:
            return error

    with ThreadPoolExecutor(size) as pool:
        return list(pool.map(run, range(size)))


def need_mpi() -> str:
    """The path of mpiexec; the test is skipped where there is no MPI."""
    beside = Path(sys.executable).parent / "mpiexec"
    command = str(beside) if beside.is_file() else shutil.which("mpiexec")
    if command is None or find_spec("mpi4py") is None:
        pytest.skip("needs mpi4py and mpiexec: pip install mpi4py mpich")
    return command


def under_mpi(module: str, ranks: int, *arguments: str, seconds: float = 240.0) -> subprocess.CompletedProcess[str]:
    """A module run by a number of ranks."""
    command = need_mpi()
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}
    return subprocess.run(
        [command, "-n", str(ranks), sys.executable, "-m", module, *arguments],
        capture_output=True,
        text=True,
        timeout=seconds,
        env=environment,
        check=False,
    )
