"""How long a change of parameters takes, and a picture."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from catalogs.cameras import Camera
from surrogate.model import Surrogate


@dataclass(frozen=True)
class Milliseconds:
    """Of several measurements of one thing."""

    median: float
    lowest: float
    highest: float

    @classmethod
    def of(cls, seconds: Sequence[float]) -> Milliseconds:
        """The summary of measurements, at least one."""
        return cls(1e3 * float(np.median(seconds)), 1e3 * min(seconds), 1e3 * max(seconds))


def measure(
    surrogate: Surrogate, parameters: Sequence[Mapping[str, float | str]], cameras: Sequence[Camera]
) -> tuple[Milliseconds, Milliseconds]:
    """Of deforming to each of the `parameters`, and of drawing each time what the camera at the same place sees."""
    changes, views = [], []
    for row, camera in zip(parameters, cameras, strict=True):
        started = time.perf_counter()
        deformed = surrogate.at(**row)
        between = time.perf_counter()
        deformed.render(camera)
        views.append(time.perf_counter() - between)
        changes.append(between - started)
    return Milliseconds.of(changes), Milliseconds.of(views)
