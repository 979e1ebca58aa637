"""Connection to an engine by its address."""

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

    `folders` are written by the tasks, `files` are read; every worker must see them.  `say` gets messages for the user, such as
    that there is no worker.  Raises ValueError for an invalid address, EngineError where no engine answers or a worker is unfit.
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
