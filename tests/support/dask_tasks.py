"""Tasks for the workers of a cluster, which import them from here."""

from __future__ import annotations

import os
import time
from pathlib import Path

from catalogs.engines.stopping import stop_requested


def square(number: int) -> int:
    return number * number


def refuse(why: str) -> None:
    raise ValueError(why)


def die() -> None:
    os._exit(9)


def noted(folder: Path, name: str, seconds: float = 0.0) -> str:
    """Leave a file `name`, and then wait."""
    (folder / name).touch()
    time.sleep(seconds)
    return name


def until_stopped(folder: Path, name: str, most: float = 60.0) -> None:
    """Leave a file `name`, wait until the task is taken back, and then leave `name`.stopped."""
    (folder / name).touch()
    begun = time.monotonic()
    while not stop_requested() and time.monotonic() - begun < most:
        time.sleep(0.02)
    (folder / f"{name}.{'stopped' if stop_requested() else 'late'}").touch()


def surroundings() -> tuple[str, str | None]:
    return os.getcwd(), os.environ.get("LP_NUM_THREADS")
