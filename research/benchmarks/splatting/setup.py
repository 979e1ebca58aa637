"""What every part of the benchmark is told."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surrogate import kernels
from surrogate.splatting.threads import cores


@dataclass(frozen=True)
class Setup:
    """How long and where.

    Attributes
    ----------
    quick : a few points, each for a moment: to try the command, not to quote.
    output : folder of the page and its plots.
    runs : folder of the scenes' catalogs.
    say : tells the user what is being done.
    """

    quick: bool
    output: Path
    runs: Path
    say: Callable[[str], None]

    @property
    def seconds(self) -> float:
        """For each timed point."""
        return 0.1 if self.quick else 1.2

    @property
    def patches(self) -> int:
        """Of 8 x 8 pixels, in which a picture is compared with the twin."""
        return 6 if self.quick else 64

    @property
    def threads(self) -> tuple[int, ...]:
        """One, and two where there are two cores."""
        return (1, 2) if cores() > 1 else (1,)

    @property
    def instruction_sets(self) -> list[str]:
        """This machine's, the best first."""
        return list(kernels.instruction_sets())


def said(threads: int) -> str:
    return f"{threads} thread" + ("s" if threads > 1 else "")


@contextmanager
def limited_to(threads: int) -> Iterator[None]:
    """Let this process have so many cores, where the system can; it takes a thread for each."""
    if not hasattr(os, "sched_setaffinity"):
        if threads != cores():
            raise OSError(f"this system can't limit a process to {threads} of {cores()} cores")
        yield
        return
    before: Any = os.sched_getaffinity(0)
    os.sched_setaffinity(0, set(sorted(before)[:threads]))
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
