"""The number of threads that kernels run on."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

PROCESS = os.getpid()
_kernel_threads: ContextVar[int | None] = ContextVar("kernel threads", default=None)


def cores() -> int:
    """Number of kernel threads: the cores available to this process, or one in a forked child.

    `kernel_threads` overrides it. A process that forks shares its cores among the children already. Processes that
    `torchrun` starts on one machine share its cores.
    """
    override = _kernel_threads.get()
    if override is not None:
        return override
    if os.getpid() != PROCESS:
        return 1
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    together = os.environ.get("LOCAL_WORLD_SIZE", "1") if "TORCHELASTIC_RUN_ID" in os.environ else "1"
    return max(1, available // int(together))


@contextmanager
def kernel_threads(count: int) -> Iterator[None]:
    """Set the number of threads of kernels that this thread calls, to share cores between processes."""
    token = _kernel_threads.set(count)
    try:
        yield
    finally:
        _kernel_threads.reset(token)
