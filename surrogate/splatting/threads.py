"""How many threads the kernels take, and torch beside them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import torch

PROCESS = os.getpid()
_kernel_threads: ContextVar[int | None] = ContextVar("kernel threads", default=None)


def cores() -> int:
    """How many threads a kernel takes: as many as this process may use cores, but one in a forked child.

    Within `kernel_threads` that many.  Who forks shares the cores among the children already.  Processes that `torchrun` starts on
    a machine share its cores.
    """
    told = _kernel_threads.get()
    if told is not None:
        return told
    if os.getpid() != PROCESS:
        return 1
    found = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    together = os.environ.get("LOCAL_WORLD_SIZE", "1") if "TORCHELASTIC_RUN_ID" in os.environ else "1"
    return max(1, found // int(together))


@contextmanager
def kernel_threads(count: int) -> Iterator[None]:
    """Let kernels that this thread calls take so many threads: who runs several processes on a machine shares its cores."""
    token = _kernel_threads.set(count)
    try:
        yield
    finally:
        _kernel_threads.reset(token)


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Run torch's own operations on so many threads; the splatting kernels use all cores all the same."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Run torch's own operations on one thread.

    They are small here (20,000 rows), and OpenMP's threads spin while they wait: on a machine with anything else to do,
    a step of 2 ms became one of 200.
    """
    with torch_threads(1):
        yield


def _one_after_fork() -> None:
    """Let a forked child compute with one thread in torch: its parent's are gone, and OpenMP would wait for ever."""
    torch.set_num_threads(1)


def _begin_alone() -> None:
    """Call the vector mathematics of MKL once, from one thread.

    It chooses its code for the processor at its first call.  Two threads that come first at once get a version of lower
    accuracy, in one start of a hundred: torch.exp then differed by 2e-5, and with it the first picture of a process.
    """
    torch.zeros(1).exp_()


_begin_alone()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_one_after_fork)
