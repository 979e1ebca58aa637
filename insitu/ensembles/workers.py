"""Worker processes: how they start, report, and stop when asked or left alone."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import signal
import threading
import time as clock
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from catalogs.engines.engine import ONE_THREAD, TICK_SECONDS
from catalogs.engines.stopping import StopRequested, stop_requested
from catalogs.plugins import PluginWarning

KILLED = "its worker process was killed, twice; if memory ran out, take fewer workers"
GRACE_SECONDS = 10.0
SPAWNED = multiprocessing.get_context("spawn")  # OpenGL does not survive a fork


@dataclass(frozen=True)
class WorkerReport:
    """A worker's report on a member: the `stage` that it entered ("simulate", "pilot", "render") and its fraction done.

    With the stages "done", "failed" and "stored" (for later) it leaves the member.
    """

    member: str
    stage: str
    fraction: float
    images: int = 0


# In a worker of our own: the queue of its reports, and the shared byte that asks it to stop.  It has one parent ...
_parent: tuple[Any, Any] | None = None
_idle = threading.Event()  # ... and one task at a time
_idle.set()


def send(report: WorkerReport) -> None:
    """Pass `report` to the process that runs the ensemble; raises StopRequested where that was interrupted.

    In the workers of another engine the report is dropped.
    """
    if stop_requested():
        raise StopRequested
    if _parent is not None:
        reports, stop = _parent
        if stop.value:
            raise StopRequested
        reports.put(report)


class WorkerPool:
    """The engine of this machine: spawned processes that take tasks and report on them.

    A context manager: on leaving it with an error, workers are asked to stop, then made to, and none stays behind.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._before = {p.pid for p in multiprocessing.active_children()}
        self._executor: Any = None
        self._queue: Any = None
        self._stop: Any = None

    def __enter__(self) -> WorkerPool:
        self._start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end(at_once=kind is not None)

    def run(
        self,
        tasks: Mapping[str, Callable[[], Any]],
        done: Callable[[str, Any], None],
        failed: Callable[[str, BaseException], None],
        tick: Callable[[Iterable[WorkerReport]], None],
        give_up: Callable[[BaseException], bool] = lambda error: False,
    ) -> None:
        """Run picklable `tasks` by name, in order, until each is `done` (with its result) or `failed` (with its error).

        `tick` gets what was reported a few times a second.  After an error for which `give_up` holds, no further task
        is begun: the rest fail with that error.  A task in whose company a worker process died is tried once more,
        alone.
        """
        waiting = deque((name, task, False) for name, task in tasks.items())  # those to be tried alone come last
        running: dict[Future[Any], tuple[str, Callable[[], Any], bool]] = {}
        try:
            while waiting or running:
                self._hand_out(waiting, running)
                finished, _ = wait(running, timeout=TICK_SECONDS, return_when=FIRST_COMPLETED)
                tick(self._reports())
                if any(isinstance(f.exception(), BrokenExecutor) for f in finished):
                    finished, _ = wait(running)  # the whole pool is gone
                    self._end(at_once=True)
                    self._start()
                for future in finished:
                    name, task, alone = running.pop(future)
                    error = future.exception()
                    if error is None:
                        done(name, future.result())
                    elif isinstance(error, BrokenExecutor) and not alone:
                        waiting.append((name, task, True))
                    else:
                        died = isinstance(error, BrokenExecutor)
                        failed(name, RuntimeError(KILLED) if died else error)
                        if give_up(error):
                            for rest, *_ in waiting:
                                failed(rest, error)
                            waiting.clear()
            tick(self._reports())
        finally:
            for future in running:
                future.cancel()

    def _hand_out(self, waiting: deque[Any], running: dict[Future[Any], Any]) -> None:
        while waiting and len(running) < self._count:
            if running and waiting[0][2]:
                return
            name, task, alone = waiting.popleft()
            running[self._executor.submit(_guarded, task)] = (name, task, alone)

    def _reports(self) -> Iterator[WorkerReport]:
        while self._queue is not None:
            try:
                yield self._queue.get_nowait()
            except queue.Empty:
                return

    def _start(self) -> None:
        self._queue = SPAWNED.Queue()
        self._stop = SPAWNED.RawValue("b", 0)  # an event has a lock, and a worker that is killed may hold it for ever
        self._executor = ProcessPoolExecutor(
            self._count, mp_context=SPAWNED, initializer=_start_worker, initargs=(self._queue, self._stop)
        )

    def _end(self, *, at_once: bool) -> None:
        if at_once:
            self._stop.value = 1
        processes = [p for p in multiprocessing.active_children() if p.pid not in self._before]
        self._executor.shutdown(wait=not at_once, cancel_futures=True)
        until = clock.monotonic() + GRACE_SECONDS
        for process in processes:
            process.join(max(0.0, until - clock.monotonic()) if at_once else None)
            if process.is_alive():
                process.kill()
                process.join()
        self._queue.close()
        self._queue.cancel_join_thread()


def _guarded(task: Callable[[], Any]) -> Any:
    """In a worker: the task's result; whatever it raises can travel to another process."""
    _idle.clear()
    try:
        return task()
    except Exception as error:
        raise _portable(error) from None
    finally:
        _idle.set()


def _portable(error: Exception) -> Exception:
    """`error`, or its description where it does not survive pickling: that would break the pool."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


@contextmanager
def single_threaded(settings: Mapping[str, str] = ONE_THREAD) -> Iterator[None]:
    """Environment for processes started within: libraries read it when they load.  What the user set stays."""
    added = {name: value for name, value in settings.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def _start_worker(reports: Any, stop: Any) -> None:
    global _parent
    _parent = reports, stop
    reports.cancel_join_thread()  # never wait at the end for someone to read
    warnings.simplefilter("ignore", PluginWarning)  # the parent gives them
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent asks us to stop
    threading.Thread(target=_leave_with_parent, args=(stop,), daemon=True).start()


def _leave_with_parent(stop: Any) -> None:
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    parent.join()
    stop.value = 1
    _idle.wait(GRACE_SECONDS)
    os._exit(1)  # this process would wait for ever for work that never comes
