"""How many threads the kernels take, and torch beside them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Run torch's own operations on one thread.

    They are small here (20,000 rows), and OpenMP's threads spin while they wait: on a machine with anything else to do,
    a step of 2 ms became one of 200.  The splatting kernels use all cores all the same.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
