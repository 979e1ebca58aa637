"""Options shared by every part of the benchmark."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from native import kernels
from native.threads import cores


@dataclass(frozen=True)
class Setup:
    """Options of the benchmark.

    Attributes
    ----------
    quick : a few points, each for a moment: to try the command, not to quote.
    output : folder of the page and its plots.
    runs : folder of the scenes' catalogs.
    say : reports progress to the user.
    """

    quick: bool
    output: Path
    runs: Path
    say: Callable[[str], None]

    @property
    def seconds(self) -> float:
        """Seconds for each timed point."""
        return 0.1 if self.quick else 1.2

    @property
    def patches(self) -> int:
        """Number of 8 x 8 patches in which an image is compared with the reference."""
        return 6 if self.quick else 64

    @property
    def threads(self) -> tuple[int, ...]:
        """Thread counts: one, and two where there are two cores."""
        return (1, 2) if cores() > 1 else (1,)

    @property
    def instruction_sets(self) -> list[str]:
        """Instruction sets of this machine, the best first."""
        return list(kernels.instruction_sets())


def said(threads: int) -> str:
    return f"{threads} thread" + ("s" if threads > 1 else "")


@contextmanager
def limited_to(threads: int) -> Iterator[None]:
    """Limit this process to `threads` cores, where the system can; it uses a thread for each."""
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
