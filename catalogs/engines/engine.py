"""Interface of all engines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

# One process per core scales better than threads within one: numpy's and Mesa's threads would fight over the cores.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}
TICK_SECONDS = 0.2

Task = Callable[[], Any]
Done = Callable[[str, Any], None]
Failed = Callable[[str, BaseException], None]
Tick = Callable[[Iterable[Any]], None]
GiveUp = Callable[[BaseException], bool]


def never_give_up(error: BaseException) -> bool:
    """False: tasks that follow an error are run."""
    return False


class EngineError(RuntimeError):
    """An engine can't be reached, has unfit workers, or was lost."""


class Engine(Protocol):
    """Runs tasks somewhere."""

    def run(
        self, tasks: Mapping[str, Task], done: Done, failed: Failed, tick: Tick, give_up: GiveUp = never_give_up
    ) -> None:
        """Run picklable `tasks` by name until each is `done` (with its result) or `failed` (with its error).

        A task whose worker dies is run once more, so tasks must be repeatable.  `tick` is called a few times a second with the
        tasks' reports, if the engine has any.  After an error for which `give_up` is true, no further task begins and the rest
        fail with that error.  After an exception from here, KeyboardInterrupt included, no further task begins either.
        """
        ...
