"""Trainings of a study on the workers of an engine, such as a Dask cluster's."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from catalogs.engines.engine import Engine
from native.threads import kernel_threads
from research.studies.progress import StudyProgress

T = TypeVar("T")
NAME = "on the cluster"


@dataclass(frozen=True)
class OnOneCore(Generic[T]):
    """A training on one core, for machines that run as many workers as they have cores."""

    training: Callable[[], T]

    def __call__(self) -> T:
        with kernel_threads(1):
            return self.training()


def train_on(
    engine: Engine,
    trainings: Mapping[str, Callable[[], T]],
    done: Callable[[T], None],
    progress: Callable[[StudyProgress], None] = lambda _: None,
) -> None:
    """Run picklable trainings by name, each of which stores its own record; `done` receives each return value.

    A training whose worker dies is started again, so it must first look for its record. Raises RuntimeError naming the
    failed ones after all others have ended.
    """
    begun, failures, ended = time.perf_counter(), dict[str, BaseException](), 0

    def settled(name: str, result: T) -> None:
        nonlocal ended
        ended += 1
        done(result)

    def tick(_: Any) -> None:
        number = ended + len(failures)
        each = (time.perf_counter() - begun) / number if number else None
        left = None if each is None else each * (len(trainings) - number)
        progress(StudyProgress(NAME, number, len(trainings), "trainings have ended", left))

    tasks = {name: OnOneCore(training) for name, training in trainings.items()}
    engine.run(tasks, settled, failures.__setitem__, tick)
    if failures:
        reasons = "; ".join(f"{name}: {type(error).__name__}: {error}" for name, error in failures.items())
        raise RuntimeError(
            f"{len(failures)} of {len(trainings)} trainings failed, and the same command tries them again: {reasons}"
        )
