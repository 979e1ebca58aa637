"""Programs, and workers of ensembles, in processes forked from one that has imported torch, VTK, xarray and the commands, since
a new interpreter takes seconds for that.

What they are forked from has no thread and nothing of the tests, so that they begin like new interpreters.
"""

from __future__ import annotations

import atexit
import os
import signal
import subprocess
import sys
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
IMPORTED = (
    "aiohttp",
    "h5netcdf",
    "insitu.ensembles.files",
    "insitu.ensembles.tasks",
    "render.isosurface",
    "render.quality",
    "render.volume",
    "surrogate.cli",
    "surrogate.explore.run",
    "surrogate.explore.server.terminal",
    "surrogate.training.run",
    "tests.support.marked",
    "tests.support.prepared",
    "vtkmodules.vtkRenderingVolumeOpenGL2",
    "xarray",
)


class _Process(ForkServerProcess):
    """A process with its parent's environment when it starts, not with that of the one that all are forked from."""

    def start(self) -> None:
        self._environment = dict(os.environ)
        super().start()

    def run(self) -> None:
        os.environ.clear()
        os.environ.update(self._environment)
        super().run()


class _Context(ForkServerContext):
    Process = _Process


CONTEXT = _Context()
CONTEXT.set_forkserver_preload(list(IMPORTED))


class Program:
    """As `subprocess.Popen([sys.executable, "-c", program, *arguments], cwd=PROJECT, text=True)` whose output is read here."""

    def __init__(self, program: str, *arguments: object) -> None:
        (out, theirs), (errors, their_errors) = CONTEXT.Pipe(duplex=False), CONTEXT.Pipe(duplex=False)
        given = (program, ["-c", *map(str, arguments)], theirs, their_errors)
        self._process = CONTEXT.Process(target=_run, args=given, daemon=True)
        self._process.start()
        self.stdout, self.stderr = (os.fdopen(os.dup(line.fileno()), encoding="utf-8") for line in (out, errors))
        for line in (out, theirs, errors, their_errors):
            line.close()

    @property
    def pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        if self.returncode is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout or 0.0)
        return self.returncode

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Its remaining output, short enough for a pipe."""
        self.wait(timeout)
        return self.stdout.read(), self.stderr.read()

    def close(self) -> None:
        self.kill()
        self.wait()
        self.stdout.close()
        self.stderr.close()


def run(program: str, *arguments: object, timeout: float = 300.0) -> tuple[int, str, str]:
    """Its status and what it writes to both streams."""
    running = Program(program, *arguments)
    try:
        out, errors = running.communicate(timeout)
        return running.wait(), out, errors
    finally:
        running.close()


def _run(program: str, arguments: list[str], out: Connection, errors: Connection) -> None:
    for line, descriptor in ((out, 1), (errors, 2)):
        os.dup2(line.fileno(), descriptor)
        line.close()
    os.chdir(PROJECT)
    sys.argv = arguments
    try:
        exec(compile(program, "<string>", "exec"), {"__name__": "__main__"})
    except KeyboardInterrupt:  # as an interpreter ends by it
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
    finally:
        atexit._run_exitfuncs()
