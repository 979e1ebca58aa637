"""The process that `insitu.background.process` starts: an interpreter that renders queued members, one after the other.

    python -P -m insitu.hook.renderer PARENT SOCKET PULSE MEMORY...

The numbers are the parent's process and descriptors that it has left open.
"""

from __future__ import annotations

import contextlib
import gc
import os
import queue
import sys
import threading
import time as clock
from multiprocessing.connection import Connection
from typing import Any

from insitu.background.process import PULSE, TICK_SECONDS
from insitu.background.segments import unpack


def main(arguments: list[str]) -> None:
    """Render until the parent closes its end of the socket; end with it, however it ends."""
    parent, socket, pulse, *memories = map(int, arguments)
    connection = Connection(socket)
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(connection, messages), daemon=True).start()
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    catalog, options = messages.get()
    with contextlib.suppress(Exception):  # reported where the first member needs it
        import render.window  # noqa: F401
    notes: list[str] = []

    def beat(images: int = 0) -> None:
        os.pwrite(pulse, PULSE.pack(clock.monotonic(), images), 0)

    writer = None
    while True:
        number, packed = messages.get()
        beat()
        notes.clear()
        try:
            if writer is None:
                from insitu.hook.writer import CatalogWriter

                writer = CatalogWriter(catalog, options, progress=beat, warn=lambda note: notes.append(str(note)))
            field, member = unpack(packed, memories[number])
            outcome: Any = writer.write(field, member)
        except Exception as error:
            outcome = f"{type(error).__name__}: {error}"
        field = member = None
        gc.collect()  # nothing may refer to the memory when it is given back
        connection.send((outcome, tuple(notes)))


def _listen(connection: Connection, messages: queue.SimpleQueue[Any]) -> None:
    """Read all the time, so that the parent never waits; end this process when the parent closes the connection."""
    try:
        while True:
            messages.put(connection.recv())
    except (EOFError, OSError):
        os._exit(0)


def _watch(parent: int) -> None:
    """End with the parent, even where one of its other children keeps the socket open."""
    while os.getppid() == parent:
        clock.sleep(TICK_SECONDS)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1:])
