"""The workers of a Dask cluster as an engine, by native futures: Dask's executors hang when a worker dies late."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from catalogs.engines.engine import TICK_SECONDS, Done, EngineError, Failed, GiveUp, Task, Tick, never_give_up
from catalogs.engines.preflight import Prepared, complaints, marked, software, threads_complaints
from catalogs.vocabulary.words import shortened

CONNECT_SECONDS = 30.0
QUIET_SECONDS = 10.0  # without a worker before it is reported
LOOK_SECONDS = 2.0  # between two counts of the workers
INSTALL = "pip install 'gs-surrogate[dask]'"


@dataclass(frozen=True)
class Cluster:
    """Runs tasks on the workers of a `client`, a `distributed.Client`; `address` is its scheduler's.

    `say` gets messages for the user: that it waits for workers, and which tasks still run after an interruption.
    """

    client: Any
    address: str
    say: Callable[[str], None] = lambda _: None

    @classmethod
    @contextmanager
    def connected(
        cls,
        address: str,
        folders: Sequence[Path] = (),
        say: Callable[[str], None] = lambda _: None,
        files: Sequence[Path] = (),
    ) -> Iterator[Cluster]:
        """The cluster of the scheduler at "tcp://HOST:PORT", after validating all present workers.

        Waits for the first worker without limit.  Raises EngineError, before any task begins, where no scheduler answers, or a
        worker is unfit or doesn't see `folders` and `files`.
        """
        try:
            from distributed import Client
        except ImportError as error:
            raise EngineError(f"--engine dask:// needs Dask, which can't be loaded ({error}): {INSTALL}") from error
        try:
            client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise EngineError(
                f"no Dask scheduler answers at {address} ({error}): start one there with `dask scheduler`"
            ) from error
        try:
            cluster = cls(client, address, say)
            cluster._check(folders, files)
            yield cluster
        finally:
            client.close()

    def run(
        self, tasks: Mapping[str, Task], done: Done, failed: Failed, tick: Tick, give_up: GiveUp = never_give_up
    ) -> None:
        """As `Engine.run`; a task whose worker dies is run on another one, up to the scheduler's `allowed-failures`.

        After an exception running tasks continue until they poll `stop_requested`; `say` gets their names.  Tasks report nothing
        until they end.  Waits for a worker where there is none.  Raises EngineError where the scheduler is lost.
        """
        from distributed import as_completed

        if not tasks:
            return
        running = {self._submitted(name, task): name for name, task in tasks.items()}
        completed, hopeless = as_completed(list(running), loop=self.client.loop), None
        absence = Absence(self.say, self.address)
        try:
            while running and hopeless is None:
                batch = completed.next_batch(block=False) if completed.queue.qsize() else ()
                if self.client.status != "running":
                    raise EngineError(f"the Dask scheduler at {self.address} is gone; finished results remain")
                if not batch:
                    time.sleep(TICK_SECONDS)
                for future in batch:
                    error = self._settled(future, running.pop(future), done, failed)
                    if error is not None and give_up(error):
                        hopeless = error
                        break
                tick(())
                absence.look(self._workers, len(running))
            for name in running.values():
                assert hopeless is not None
                failed(name, hopeless)
        finally:
            if running:
                with suppress(Exception):  # of a scheduler that is gone
                    self._cancel(running)

    def _cancel(self, running: Mapping[Any, str]) -> None:
        """Cancel all tasks, and report those that had begun."""
        keys = {key for keys in self.client.run(executing, on_error="ignore").values() for key in keys}
        self.client.cancel(list(running), force=True)
        begun = [name for future, name in running.items() if future.key in keys]
        if begun:
            others = len(running) - len(begun)
            queued = f"; {others} queued tasks cancelled" if others else ""
            self.say(f"stopping {shortened(begun, 5)} at the next safe point{queued}")

    def _submitted(self, name: str, task: Task) -> Any:
        prepared = Prepared(task, software(), os.getcwd(), threads_here)
        return self.client.submit(prepared, key=f"{name}-{uuid4().hex}", pure=False)

    def _settled(self, future: Any, name: str, done: Done, failed: Failed) -> BaseException | None:
        """The error with which a task ended, if it did."""
        try:
            result = future.result()  # computed once more where its worker has died since
        except Exception as error:
            reason = plain_error(error)
            failed(name, reason)
            return reason
        done(name, result)
        return None

    def _check(self, folders: Sequence[Path], files: Sequence[Path]) -> None:
        self._wait_for_a_worker()
        with marked(folders) as marks:
            expected = software(), marks, os.getcwd(), [str(file.absolute()) for file in files]
            of_workers = dict(self.client.run(complaints, *expected, on_error="return"))
            problems = {"the scheduler": self._of_scheduler()} | {f"worker {a}": p for a, p in of_workers.items()}
        threads = {f"worker {address}": count for address, count in self.client.nthreads().items()}
        lines = []
        for process, texts in problems.items():
            if isinstance(texts, BaseException):
                texts = [f"can't load gs-surrogate ({type(texts).__name__}: {texts}): {INSTALL} there"]
            lines += [f"{process} {problem}" for problem in [*texts, *threads_complaints(threads.get(process, 1))]]
        if lines:
            more = f"; and {len(lines) - 5} more" if len(lines) > 5 else ""
            raise EngineError(f"the Dask cluster at {self.address} is not fit: {'; '.join(lines[:5])}{more}")

    def _wait_for_a_worker(self) -> None:
        absence = Absence(self.say, self.address)
        while not absence.look(self._workers):
            if self.client.status != "running":
                raise EngineError(f"the Dask scheduler at {self.address} is gone")
            time.sleep(TICK_SECONDS)

    def _workers(self) -> int | None:
        """Number of workers; None where the scheduler does not answer."""
        with suppress(Exception):
            return len(self.client.nthreads())
        return None

    def _of_scheduler(self) -> list[str] | BaseException:
        """Problems of the scheduler, which unpickles tasks but runs none and need not see the folders."""
        try:
            return list(self.client.run_on_scheduler(complaints, software(), (), os.sep))
        except Exception as error:
            return error


@dataclass
class Absence:
    """Reports once by `say` when the scheduler at `address` has had no worker for a while, and when one has come."""

    say: Callable[[str], None]
    address: str
    _looked: float = -math.inf
    _absent_since: float | None = None
    _present: bool = False
    _reported: bool = False

    def look(self, count: Callable[[], int | None], waiting: int = 0) -> bool:
        """True if there was a worker at the last `count`, which is called every few seconds; `waiting` tasks need one."""
        now = time.monotonic()
        if now - self._looked >= LOOK_SECONDS:
            self._looked = now
            self._note(count(), now)
        if self._absent_since is not None and not self._reported and now - self._absent_since >= QUIET_SECONDS:
            what = f", for which {waiting} tasks wait" if waiting else ", and it waits for one"
            self.say(
                f"the Dask scheduler at {self.address} has no worker{what}: start some with "
                f"`dask worker {self.address} --nthreads 1 --nworkers N`"
            )
            self._reported = True
        return self._present

    def _note(self, count: int | None, now: float) -> None:
        """Note the present number of workers, None where unknown."""
        if count is None:
            return
        self._present = count > 0
        if self._present and self._reported:
            self.say("a worker has come: it goes on")
        if self._present:
            self._absent_since, self._reported = None, False
        elif self._absent_since is None:
            self._absent_since = now


def executing(dask_worker: Any) -> list[str]:
    """On a worker: the keys of its running tasks."""
    return [task.key for task in dask_worker.state.executing]


def threads_here() -> int:
    """On a worker: the number of tasks that it runs at once."""
    from distributed import get_worker

    return int(get_worker().state.nthreads)


def plain_error(error: BaseException) -> BaseException:
    """The error, with Dask's `KilledWorker` explained."""
    from distributed.scheduler import KilledWorker

    if not isinstance(error, KilledWorker):
        return error
    return RuntimeError(
        "each worker that tried it died; its log says why: if memory ran out, start fewer workers on a machine, each with a "
        f"larger --memory-limit ({error.last_worker.address} was the last)"
    )
