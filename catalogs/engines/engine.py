"""What all engines have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

# One process per core scales better than threads within one: numpy's and Mesa's threads would fight over the cores.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}
TICK_SECONDS = 0.2

Task = Callable[[], Any]


class EngineError(RuntimeError):
    """An engine can't be reached, is not fit for the work, or was lost."""


class Engine(Protocol):
    """Runs tasks somewhere."""

    def run(
        self,
        tasks: Mapping[str, Task],
        done: Callable[[str, Any], None],
        failed: Callable[[str, BaseException], None],
        tick: Callable[[Iterable[Any]], None],
        give_up: Callable[[BaseException], bool] = lambda error: False,
    ) -> None:
        """Run picklable `tasks` by name until each is `done` (with its result) or `failed` (with its error).

        A task whose worker dies is run once more, so tasks must be such that this does no harm.  `tick` is called a few times a
        second, with what tasks reported since, if the engine knows.  After an error for which `give_up` holds, no further task is
        begun: the rest fail with that error.  Where this is left with an error, KeyboardInterrupt included, no further task is
        begun either.
        """
        ...
