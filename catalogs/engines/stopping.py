"""Cooperative cancellation: long tasks poll `stop_requested()`."""

from __future__ import annotations

import sys
import threading


class StopRequested(Exception):
    """Raised by a task that stops at a safe point after an interruption."""


def stop_requested() -> bool:
    """True where this thread's task was cancelled; False outside of a Dask cluster's workers."""
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
