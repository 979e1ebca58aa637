"""The workers of a Dask cluster as an engine: native futures, since executors made of them hang when a worker dies late."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from catalogs.engines.engine import TICK_SECONDS, EngineError, Task
from catalogs.engines.preflight import Prepared, complaints, marked, software, threads_complaints
from catalogs.vocabulary.words import shortened

CONNECT_SECONDS = 30.0
QUIET_SECONDS = 10.0  # without a worker, before anybody is told
LOOK_SECONDS = 2.0  # between two looks at the workers
INSTALL = "pip install 'gs-surrogate[dask]'"


@dataclass(frozen=True)
class Cluster:
    """Runs tasks on the workers of a `client`, a `distributed.Client`; `address` is its scheduler's.

    `say` is told what a user should know while it goes on: that it waits for workers, and what they are at when it is left.
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
        """The cluster of the scheduler at "tcp://HOST:PORT", all of whose present workers are fit, and see `folders` and `files`.

        It waits for the first worker, as long as that takes.  Raises EngineError where there is no scheduler, or a worker is not
        fit, before any task begins.
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
        self,
        tasks: Mapping[str, Task],
        done: Callable[[str, Any], None],
        failed: Callable[[str, BaseException], None],
        tick: Callable[[Iterable[Any]], None],
        give_up: Callable[[BaseException], bool] = lambda error: False,
    ) -> None:
        """As `Engine.run`; a task whose worker dies is run on another one, up to the scheduler's `allowed-failures`.

        What workers are at when this is left with an error, they go on with until they ask `stop_requested`, and `say` is told
        which tasks these are; tasks report nothing until they end.
        Without any worker it waits for one.  Raises EngineError where the scheduler is lost.
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
                    raise EngineError(f"the Dask scheduler at {self.address} is gone; what was finished is kept")
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
                    self._take_back(running)

    def _take_back(self, running: Mapping[Any, str]) -> None:
        """Cancel everything, and say what had begun."""
        found = self.client.run(executing, on_error="ignore")
        begun = {key for keys in found.values() for key in keys}
        self.client.cancel(list(running), force=True)
        at_work = [name for future, name in running.items() if future.key in begun]
        if at_work:
            others = len(running) - len(at_work)
            taken_back = f"; {others} that had not begun were taken back" if others else ""
            self.say(f"workers stop, where that leaves nothing half-done, {shortened(at_work, 5)}{taken_back}")

    def _submitted(self, name: str, task: Task) -> Any:
        prepared = Prepared(task, software(), os.getcwd(), threads_here)
        return self.client.submit(prepared, key=f"{name}-{uuid4().hex}", pure=False)

    def _settled(
        self,
        future: Any,
        name: str,
        done: Callable[[str, Any], None],
        failed: Callable[[str, BaseException], None],
    ) -> BaseException | None:
        """The error with which a task ended, if it did."""
        try:
            result = future.result()  # computed once more where its worker has died since
        except Exception as error:
            told = told_error(error)
            failed(name, told)
            return told
        done(name, result)
        return None

    def _check(self, folders: Sequence[Path], files: Sequence[Path]) -> None:
        self._wait_for_a_worker()
        with marked(folders) as marks:
            asked = software(), marks, os.getcwd(), [str(file.absolute()) for file in files]
            found = dict(self.client.run(complaints, *asked, on_error="return"))
            with_scheduler = {"the scheduler": self._of_scheduler()} | {f"worker {a}": f for a, f in found.items()}
        threads = {f"worker {address}": count for address, count in self.client.nthreads().items()}
        lines = []
        for who, wrong in with_scheduler.items():
            if isinstance(wrong, BaseException):
                wrong = [f"can't load gs-surrogate ({type(wrong).__name__}: {wrong}): {INSTALL} there"]
            lines += [f"{who} {what}" for what in [*wrong, *threads_complaints(threads.get(who, 1))]]
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
        """How many there are; None where the scheduler does not answer."""
        with suppress(Exception):
            return len(self.client.nthreads())
        return None

    def _of_scheduler(self) -> list[str] | BaseException:
        """What is wrong with the scheduler, which unpacks tasks to hand them on but runs none: it need see no folder."""
        try:
            return list(self.client.run_on_scheduler(complaints, software(), (), os.sep))
        except Exception as error:
            return error


@dataclass
class Absence:
    """Tells `say` once when the scheduler at `address` has had no worker for a while, and when there is one again."""

    say: Callable[[str], None]
    address: str
    _looked: float = -math.inf
    _absent: float | None = None  # since when
    _is_there: bool = False
    _is_told: bool = False

    def look(self, count: Callable[[], int | None], waiting: int = 0) -> bool:
        """Whether a worker was there when somebody last looked, which `count` does every few seconds; `waiting` tasks need one."""
        now = time.monotonic()
        if now - self._looked >= LOOK_SECONDS:
            self._looked = now
            self._note(count(), now)
        if self._absent is not None and not self._is_told and now - self._absent >= QUIET_SECONDS:
            what = f", for which {waiting} tasks wait" if waiting else ", and it waits for one"
            self.say(
                f"the Dask scheduler at {self.address} has no worker{what}: start some with "
                f"`dask worker {self.address} --nthreads 1 --nworkers N`"
            )
            self._is_told = True
        return self._is_there

    def _note(self, count: int | None, now: float) -> None:
        """So many are there now; None where nobody knows."""
        if count is None:
            return
        self._is_there = count > 0
        if self._is_there and self._is_told:
            self.say("a worker has come: it goes on")
        if self._is_there:
            self._absent, self._is_told = None, False
        elif self._absent is None:
            self._absent = now


def executing(dask_worker: Any) -> list[str]:
    """On a worker: the keys of the tasks that it is at."""
    return [task.key for task in dask_worker.state.executing]


def threads_here() -> int:
    """On a worker: how many tasks it runs at once."""
    from distributed import get_worker

    return int(get_worker().state.nthreads)


def told_error(error: BaseException) -> BaseException:
    """The error, or in words what Dask's own of a worker that died again and again means."""
    from distributed.scheduler import KilledWorker

    if not isinstance(error, KilledWorker):
        return error
    return RuntimeError(
        "each worker that tried it died; its log says why: if memory ran out, start fewer workers on a machine, each with a "
        f"larger --memory-limit ({error.last_worker.address} was the last)"
    )
