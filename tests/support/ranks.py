"""Processes that train together, as `torchrun` would start them, forked from one that has imported torch."""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Iterator

import pytest
import torch.distributed

from tests.support.prepared import Program

PRELUDE = """
import json, os, sys
os.environ.update(json.loads(sys.argv.pop(1)))
from surrogate.training.ranks import launched
"""
LIMIT = 240.0  # seconds, on a machine with anything else to do


def require_gloo() -> None:
    """Skip the test where processes can't talk to each other."""
    if not (torch.distributed.is_available() and torch.distributed.is_gloo_available()):
        pytest.skip("this torch has no torch.distributed with gloo")


@contextlib.contextmanager
def started(program: str, *arguments: object, count: int = 2) -> Iterator[list[Program]]:
    """Processes that run the same program, by rank; they end with the context."""
    require_gloo()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    running: list[Program] = []
    try:
        for rank in range(count):
            told = {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": count, "LOCAL_WORLD_SIZE": count}
            told |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "TORCHELASTIC_RUN_ID": "test"}
            told |= {"OMP_NUM_THREADS": 1, "GLOO_SOCKET_IFNAME": "lo"}
            environment = json.dumps({name: str(value) for name, value in told.items()})
            running.append(Program(PRELUDE + program, environment, *arguments))
        yield running
    finally:
        for process in running:
            process.close()


def outputs(program: str, *arguments: object, count: int = 2) -> list[str]:
    """The output of each process, by rank; raises AssertionError if one fails."""
    with started(program, *arguments, count=count) as running:
        told = [process.communicate(LIMIT) for process in running]
        failed = [errors for process, (_, errors) in zip(running, told, strict=True) if process.wait() != 0]
        assert not failed, "\n".join(failed)
        return [out for out, _ in told]
