"""Whether whoever gave a task to an engine has taken it back, which a long one asks now and then: nothing stops it from outside."""

from __future__ import annotations

import sys
import threading


class StopRequested(Exception):
    """The work was interrupted; raised by a task on its way so that it leaves nothing half-done."""


def stop_requested() -> bool:
    """Whether the task that this thread runs was taken back; False outside of a Dask cluster's workers."""
    if "distributed" not in sys.modules:
        return False
    from distributed import get_worker

    try:
        worker = get_worker()
    except ValueError:
        return False
    key = worker.active_threads.get(threading.get_ident())
    task = None if key is None else worker.state.tasks.get(key)
    return key is not None and (task is None or task.state == "cancelled")
