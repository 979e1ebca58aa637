"""Whether the workers of a cluster can do the work: asked of all before it begins, and by each before every task."""

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


@functools.cache  # a process that was started before an update goes on with the code from before
def software() -> str:
    """What runs here, such as "gs-surrogate 0.1.0 (commit 1a2b3c4d5e6f), Python 3.11"."""
    return f"gs-surrogate {described()}, Python {'.'.join(platform.python_version_tuple()[:2])}"


@contextmanager
def marked(folders: Sequence[Path]) -> Iterator[list[str]]:
    """Files that lie in each of `folders`, or the nearest folder above that exists, until the context is left; their paths."""
    with ExitStack() as stack:
        paths = []
        for folder in folders:
            near = next(parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.is_dir())
            paths.append(stack.enter_context(tempfile.NamedTemporaryFile(dir=near, prefix=".engine-")).name)
        yield paths


def complaints(wanted: str, marks: Sequence[str], folder: str, files: Sequence[str] = ()) -> list[str]:
    """On a worker or the scheduler: what is wrong there, in words.

    `folder` is the one that the work begins in, `files` are some that it reads.
    """
    found = [] if software() == wanted else [f"runs {software()}, not {wanted}: install the same there, and restart it"]
    for mark in marks:
        place = os.path.dirname(mark)
        if not os.path.exists(mark):
            found.append(f"does not see the folder {place}: it must be on a file system that all machines share")
        elif not os.access(place, os.W_OK):
            found.append(f"may not write to {place}")
    found += [
        f"does not see {file}: it must be on a file system that all machines share"
        for file in files
        if not os.access(file, os.R_OK)
    ]
    if not os.path.isdir(folder):
        found.append(f"has no folder {folder}, which paths are relative to: start from a shared one")
    return found


@dataclass(frozen=True)
class Prepared:
    """A task that sees to it that its worker is fit and set up: workers may have joined after all were asked.

    Attributes
    ----------
    task : what is run.
    software : what must run there, see `software`.
    folder : the one that relative paths mean.
    threads : tells how many tasks the worker runs at once.
    """

    task: Task
    software: str
    folder: str
    threads: Callable[[], int]

    def __call__(self) -> Any:
        """The task's result; raises RuntimeError where the worker is not fit."""
        wrong = complaints(self.software, (), self.folder) + threads_complaints(self.threads())
        if wrong:
            raise RuntimeError(f"its worker on {platform.node()} {'; '.join(wrong)}")
        for name, value in ONE_THREAD.items():
            os.environ.setdefault(name, value)  # read by Mesa at its first picture; Dask itself sets OpenMP's
        os.chdir(self.folder)
        return self.task()


def threads_complaints(threads: int) -> list[str]:
    """OpenGL does not bear two threads that draw in one process."""
    return [] if threads == 1 else [f"has {threads} threads: start it with --nthreads 1, and more with --nworkers"]
