"""The workers of a Dask cluster as an engine: native futures, since executors made of them hang when a worker dies late."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from engines.engine import TICK_SECONDS, EngineError, Task
from engines.preflight import Prepared, complaints, marked, software, threads_complaints

CONNECT_SECONDS = 30.0
WORKER_SECONDS = 300.0  # a batch system may take its time
INSTALL = "pip install 'gs-surrogate[dask]'"


@dataclass(frozen=True)
class Cluster:
    """Runs tasks on the workers of a `client`, a `distributed.Client`; `address` is its scheduler's."""

    client: Any
    address: str

    @classmethod
    @contextmanager
    def connected(cls, address: str, folders: Sequence[Path] = ()) -> Iterator[Cluster]:
        """The cluster of the scheduler at "tcp://HOST:PORT", all of whose present workers are fit and see `folders`.

        Raises EngineError where there is none, no worker comes, or one is not fit, before any task begins.
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
            cluster = cls(client, address)
            cluster._check(folders)
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

        What workers are at when this is left with an error, they finish; tasks report nothing until they end.  Raises
        EngineError where the scheduler is lost.
        """
        from distributed import as_completed

        if not tasks:
            return
        running = {self._submitted(name, task): name for name, task in tasks.items()}
        completed, hopeless = as_completed(list(running), loop=self.client.loop), None
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
            for name in running.values():
                assert hopeless is not None
                failed(name, hopeless)
        finally:
            if running:
                with suppress(Exception):  # of a scheduler that is gone
                    self.client.cancel(list(running), force=True)

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

    def _check(self, folders: Sequence[Path]) -> None:
        try:
            self.client.wait_for_workers(1, timeout=WORKER_SECONDS)
        except TimeoutError as error:
            raise EngineError(
                f"the Dask scheduler at {self.address} has had no worker for {WORKER_SECONDS:g} s: start some with "
                f"`dask worker {self.address} --nthreads 1 --nworkers N`"
            ) from error
        with marked(folders) as marks:
            asked = software(), marks, os.getcwd()
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

    def _of_scheduler(self) -> list[str] | BaseException:
        """What is wrong with the scheduler, which unpacks tasks to hand them on but runs none: it need see no folder."""
        try:
            return list(self.client.run_on_scheduler(complaints, software(), (), os.sep))
        except Exception as error:
            return error


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
