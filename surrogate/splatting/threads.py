"""Numbers of threads of torch."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Run torch's own operations on `count` threads; the splatting kernels still use all cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Run torch's own operations on one thread.

    They are small here (20,000 rows), and OpenMP's threads spin while they wait: on a busy machine a step of 2 ms took
    200.
    """
    with torch_threads(1):
        yield


def _one_after_fork() -> None:
    """Limit torch to one thread in a forked child: its parent's threads are gone, and OpenMP would wait forever."""
    torch.set_num_threads(1)


def _begin_alone() -> None:
    """Call the vector mathematics of MKL once, from one thread.

    MKL chooses its code for the processor at the first call. When the first calls of two threads coincide, in one start of
    a hundred, they get a version of lower accuracy. Results of torch.exp then differed by 2e-5, and with them the first
    image of a process.
    """
    torch.zeros(1).exp_()


_begin_alone()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_one_after_fork)
