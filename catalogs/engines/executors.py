"""Any executor of `concurrent.futures` as an engine, such as mpi4py's."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from dataclasses import dataclass

from catalogs.engines.engine import TICK_SECONDS, Done, Failed, GiveUp, Task, Tick, never_give_up


@dataclass(frozen=True)
class OnExecutor:
    """Runs tasks on an `executor`, whose worker processes it neither starts nor ends nor replaces."""

    executor: Executor

    def run(
        self, tasks: Mapping[str, Task], done: Done, failed: Failed, tick: Tick, give_up: GiveUp = never_give_up
    ) -> None:
        """As `Engine.run`, but a task whose worker died has failed."""
        running = {self.executor.submit(task): name for name, task in tasks.items()}
        hopeless: BaseException | None = None
        try:
            while running:
                finished, _ = wait(running, timeout=TICK_SECONDS, return_when=FIRST_COMPLETED)
                for future in finished:
                    name = running.pop(future)
                    error = hopeless if future.cancelled() else future.exception()
                    if error is None:
                        done(name, future.result())
                        continue
                    failed(name, error)
                    if hopeless is None and give_up(error):
                        hopeless = error
                        for other in running:
                            other.cancel()
                tick(())
        finally:
            for future in running:
                future.cancel()
