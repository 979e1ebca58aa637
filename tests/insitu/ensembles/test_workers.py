"""Workers that are killed at whatever moment hold up nobody."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import Counter

import pytest

from insitu.ensembles.workers import KILLED, WorkerPool, WorkerReport, send

ROUNDS, THREADS = 3, 4


def report_all_the_time() -> None:
    """So that it is killed in the midst of a report."""
    until = time.monotonic() + 0.5

    def report() -> None:
        while time.monotonic() < until:
            send(WorkerReport("m", "render", 0.5))

    threads = [threading.Thread(target=report) for _ in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def die() -> None:
    time.sleep(0.1)
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.timeout(60)
def test_a_worker_that_is_killed_while_it_reports_holds_up_nobody() -> None:
    ended: Counter[str] = Counter()
    for _ in range(ROUNDS):
        with WorkerPool(2) as pool:
            pool.run(
                {"reports": report_all_the_time, "dies": die},
                done=lambda name, _: ended.update([name]),
                failed=lambda name, error: ended.update([f"{name}: {error}"]),
                tick=lambda reports: ended.update({"reports seen": sum(1 for _ in reports)}),
            )
    assert ended.pop("reports seen") > ROUNDS
    assert ended == {"reports": ROUNDS, f"dies: {KILLED}": ROUNDS}
