"""How an engine is found by its address."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from catalogs.engines.cluster import Cluster

DASK = "dask://"


@contextmanager
def opened(
    address: str | None,
    folders: Sequence[Path] = (),
    say: Callable[[str], None] = lambda _: None,
    *,
    files: Sequence[Path] = (),
) -> Iterator[Cluster | None]:
    """The engine at an address such as "dask://10.0.0.1:8786"; None for None.

    `folders` are those that the tasks write to, `files` such as they read; every worker must see them.  `say` is told what a user
    should know, such as that there is no worker to do the work.  Raises ValueError for what is no
    address, EngineError where there is no such engine, or it is not fit.
    """
    if address is None:
        yield None
        return
    place = address.removeprefix(DASK)
    host, colon, port = place.rpartition(":")
    if place == address or not (host and colon and port.isdecimal() and 0 < int(port) < 65536):
        raise ValueError(f"--engine takes dask://HOST:PORT, the address of a Dask scheduler, got {address!r}")
    with Cluster.connected(f"tcp://{place}", folders, say, files) as cluster:
        yield cluster
