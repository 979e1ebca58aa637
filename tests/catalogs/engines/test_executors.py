"""Any executor as an engine."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from catalogs.engines.executors import OnExecutor
from tests.support import dask_tasks


def test_results_errors_and_giving_up() -> None:
    def fail() -> None:
        raise OSError("disk full")

    done: dict[str, Any] = {}
    failed: dict[str, BaseException] = {}
    with ThreadPoolExecutor(1) as threads:
        tasks: dict[str, Any] = {"first": lambda: dask_tasks.square(3), "bad": fail}
        tasks |= {str(i): partial(time.sleep, 0.05) for i in range(20)}
        OnExecutor(threads).run(tasks, done.__setitem__, failed.__setitem__, lambda _: None, lambda e: True)
    assert done["first"] == 9
    assert len(done) + len(failed) == 22
    assert {str(error) for error in failed.values()} == {"disk full"}
    assert len(failed) > 1
