"""Processes that train one surrogate together, on one machine or many, as `torchrun` starts them.

Each draws its share of a step's pictures.  One sum over all processes gives everyone the same gradients.  All compute the
same steps from them, so that their parameters stay equal bit for bit on processors of one kind.  Whatever a clock, a file or a
signal decides, the first process decides for all.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import Tensor

TIMEOUT = timedelta(minutes=10)  # as long a process may do without the others, such as load images from a slower disk

T = TypeVar("T")


class ProcessLost(RuntimeError):
    """A process of the training ended, or does not answer."""


class FailedElsewhere(RuntimeError):
    """Another process of the training failed, and tells why."""


@dataclass(frozen=True)
class Ranks:
    """`count` processes that train together, of which this is number `rank` from 0; by itself, one alone.

    All of them must call the same methods in the same order: each waits for the others.  Where one has ended, or they wait for it
    in vain, `ProcessLost` is raised.
    """

    rank: int = 0
    count: int = 1

    @property
    def is_first(self) -> bool:
        """True for the process that writes files and reports progress."""
        return self.rank == 0

    def share(self, count: int) -> range:
        """Which of `count` items are this process's: each is one's, and nobody has over one more than another."""
        return range(self.rank * count // self.count, (self.rank + 1) * count // self.count)

    def add(self, *tensors: Tensor) -> None:
        """Add up tensors of one type on one device over all processes, in place, in a single all-reduce."""
        self._reduce(dist.ReduceOp.SUM if self.count > 1 else None, tensors)

    def maximum(self, tensor: Tensor) -> None:
        """Let every element be its largest in any process, in place."""
        self._reduce(dist.ReduceOp.MAX if self.count > 1 else None, (tensor,))

    def gathered(self, value: T) -> list[T]:
        """The value of each process, by rank; sent pickled."""
        if self.count == 1:
            return [value]
        values: list[T] = [value] * self.count
        with _loss_told():
            dist.all_gather_object(values, value)
        return values

    def agreed(self, value: T) -> T:
        """The first process's value; sent pickled."""
        if self.count == 1:
            return value
        box = [value if self.is_first else None]
        with _loss_told():
            dist.broadcast_object_list(box, src=0, device=torch.device("cpu"))
        return box[0]  # type: ignore[return-value]

    def by_first(self, work: Callable[[], T]) -> T:
        """The result of `work` in the first process, which alone does it; the others raise its errors as `FailedElsewhere`."""
        if self.count == 1:
            return work()
        result: T | None = None
        failure: BaseException | None = None
        try:
            result = work() if self.is_first else None
        except BaseException as error:
            failure = error
        result, said = self.agreed((result, "" if failure is None else f"{type(failure).__name__}: {failure}"))
        if failure is not None:
            raise failure
        if said:
            raise FailedElsewhere(f"the first process failed: {said}")
        return result  # type: ignore[return-value]

    def raise_any(self, failure: Exception | None, shared: type[Exception] = FailedElsewhere) -> None:
        """Raise `failure` or, in processes without one, another's: as it is if it is a `shared` error, else `FailedElsewhere`."""
        failures = self.gathered(None if failure is None else (isinstance(failure, shared), str(failure)))
        if failure is not None:
            raise failure
        for rank, one in enumerate(failures):
            if one is not None:
                is_shared, text = one
                raise shared(text) if is_shared else FailedElsewhere(f"process {rank} failed: {text}")

    def _reduce(self, operation: dist.ReduceOp.RedOpType | None, tensors: tuple[Tensor, ...]) -> None:
        if operation is None:
            return
        with torch.no_grad():
            flat = torch.cat([tensor.detach().reshape(-1) for tensor in tensors])
            with _loss_told():
                dist.all_reduce(flat, operation)
            for tensor, part in zip(tensors, flat.split([tensor.numel() for tensor in tensors]), strict=True):
                tensor.copy_(part.view_as(tensor))  # each begins as well aligned as before


ALONE = Ranks()


@contextmanager
def launched() -> Iterator[Ranks]:
    """The processes that `torchrun` started this one with; a process that it did not start is alone.

    They reduce tensors by gloo in main memory and by NCCL on GPUs, of which each process of a machine takes its own.  A process in
    which `FailedElsewhere` is raised ends without a word: another one tells why.
    """
    if "TORCHELASTIC_RUN_ID" not in os.environ or os.environ.get("WORLD_SIZE") == "1":
        yield ALONE
        return
    if not dist.is_available():
        raise RuntimeError(f"torch {torch.__version__} was built without torch.distributed: start one process")
    by_gpu = torch.cuda.is_available() and dist.is_nccl_available()
    if by_gpu:
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]) % torch.cuda.device_count())
    with _loss_told():
        dist.init_process_group("cpu:gloo,cuda:nccl" if by_gpu else "gloo", timeout=TIMEOUT)
    try:
        yield Ranks(dist.get_rank(), dist.get_world_size())
    except FailedElsewhere:
        raise SystemExit(0) from None  # so that torchrun names the process that failed
    finally:
        dist.destroy_process_group()


def require_own_gpu(ranks: Ranks, device: torch.device) -> None:
    """Raise RuntimeError where processes of a machine would have to share a GPU, which NCCL refuses."""
    here = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    if ranks.count > 1 and device.type == "cuda" and here > torch.cuda.device_count():
        raise RuntimeError(
            f"{here} processes on a machine with {torch.cuda.device_count()} GPUs: start at most one for each "
            "(--nproc-per-node)"
        )


@contextmanager
def _loss_told() -> Iterator[None]:
    """Tell in plain words when the others do not answer."""
    try:
        yield
    except RuntimeError as error:
        raise ProcessLost(
            "a process of this training ended or does not answer, so the others can't go on; the last checkpoint stays, and the "
            f"same command goes on from it ({str(error).splitlines()[0]})"
        ) from error
