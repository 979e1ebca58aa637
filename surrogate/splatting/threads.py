"""How many threads torch takes, while the kernels bring their own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


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
