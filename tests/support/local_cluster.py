"""A Dask scheduler and worker processes on this machine, for tests that kill them."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
# Workers without watchdogs and dashboards.
SETTINGS = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "20", "DASK_DISTRIBUTED__ADMIN__TICK__LIMIT": "1h"}


@dataclass
class LocalCluster:
    """`address` for `--engine`; workers have no nannies, so a killed one stays dead."""

    address: str
    scheduler: subprocess.Popen[bytes]
    folder: Path
    environment: dict[str, str]
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def add_worker(self, *options: str) -> subprocess.Popen[bytes]:
        chosen = options or ("--nthreads", "1")
        place = ["--no-dashboard", "--local-directory", str(self.folder), "--host", "127.0.0.1"]
        scheduler = self.address.replace("dask://", "tcp://")
        process = _started(["worker", scheduler, "--no-nanny", *place, *chosen], self.folder, self.environment)
        self.workers.append(process)
        return process

    def kill(self, process: subprocess.Popen[bytes]) -> None:
        process.kill()
        process.wait()
        self.workers.remove(process)


@contextmanager
def local_cluster(folder: Path, workers: int = 2) -> Iterator[LocalCluster]:
    """A scheduler and `workers` of one thread; they end with the context."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environment = {**os.environ, **SETTINGS, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    scheduler = _started(
        ["scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"], folder, environment
    )
    cluster = LocalCluster(f"dask://127.0.0.1:{port}", scheduler, folder, environment)
    try:
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
    finally:
        for process in [*cluster.workers, scheduler]:
            process.kill()
            process.wait()


def _started(arguments: list[str], folder: Path, environment: dict[str, str]) -> subprocess.Popen[bytes]:
    with open(folder / "dask.log", "ab") as log:
        command = [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]]
        return subprocess.Popen(command, cwd=PROJECT, env=environment, stdout=log, stderr=log)
