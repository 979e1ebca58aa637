"""Validation of a cluster's workers: all before the work begins, and each one before every task."""

from __future__ import annotations

import functools
import os
import platform
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from catalogs.engines.engine import ONE_THREAD, Task
from catalogs.version import described


@functools.cache  # a process from before an update still runs the old code
def software() -> str:
    """Versions of this process, such as "gs-surrogate 0.1.0 (commit 1a2b3c4d5e6f), Python 3.11"."""
    return f"gs-surrogate {described()}, Python {'.'.join(platform.python_version_tuple()[:2])}"


@contextmanager
def marked(folders: Sequence[Path]) -> Iterator[list[str]]:
    """Paths of temporary files in each of `folders`, or in its nearest existing parent."""
    with ExitStack() as stack:
        paths = []
        for folder in folders:
            near = next(parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.is_dir())
            paths.append(stack.enter_context(tempfile.NamedTemporaryFile(dir=near, prefix=".engine-")).name)
        yield paths


def complaints(expected: str, marks: Sequence[str], folder: str, files: Sequence[str] = ()) -> list[str]:
    """Problems of the worker or scheduler that runs this: its software, unseen `marks` or `files`, a missing working `folder`."""
    problems = []
    if software() != expected:
        problems.append(f"runs {software()}, not {expected}: install the same there, and restart it")
    for mark in marks:
        place = os.path.dirname(mark)
        if not os.path.exists(mark):
            problems.append(f"does not see the folder {place}: it must be on a file system that all machines share")
        elif not os.access(place, os.W_OK):
            problems.append(f"may not write to {place}")
    problems += [
        f"does not see {file}: it must be on a file system that all machines share"
        for file in files
        if not os.access(file, os.R_OK)
    ]
    if not os.path.isdir(folder):
        problems.append(f"has no folder {folder}, which paths are relative to: start from a shared one")
    return problems


@dataclass(frozen=True)
class Prepared:
    """A task that validates and prepares its worker first, which may have joined late.

    Attributes
    ----------
    task : the function to run.
    software : the required versions, see `software`.
    folder : the working folder.
    threads : returns the number of tasks that the worker runs at once.
    """

    task: Task
    software: str
    folder: str
    threads: Callable[[], int]

    def __call__(self) -> Any:
        """The task's result; raises RuntimeError where the worker is unfit."""
        if problems := complaints(self.software, (), self.folder) + threads_complaints(self.threads()):
            raise RuntimeError(f"its worker on {platform.node()} {'; '.join(problems)}")
        for name, value in ONE_THREAD.items():
            os.environ.setdefault(name, value)  # read by Mesa at its first image; Dask itself sets OpenMP's
        os.chdir(self.folder)
        return self.task()


def threads_complaints(threads: int) -> list[str]:
    """Problem of a worker with several threads: OpenGL can't draw in two threads of one process."""
    return [] if threads == 1 else [f"has {threads} threads: start it with --nthreads 1, and more with --nworkers"]
