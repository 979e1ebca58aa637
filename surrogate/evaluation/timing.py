"""Times of a parameter change and of a view change."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from catalogs.store.catalog import Member
from surrogate.model import Surrogate

TIMED = 30


@dataclass(frozen=True)
class Milliseconds:
    """Median and range of repeated measurements."""

    median: float
    lowest: float
    highest: float

    @classmethod
    def of(cls, seconds: Sequence[float]) -> Milliseconds:
        """The summary of one or more measurements."""
        return cls(1e3 * float(np.median(seconds)), 1e3 * min(seconds), 1e3 * max(seconds))


def measure(
    surrogate: Surrogate, members: Sequence[Member], settings: Sequence[Mapping[str, float | str]] = ({},)
) -> tuple[Milliseconds, Milliseconds]:
    """Times of deforming to the parameters of members under `settings`, in turn, and of rendering one view after each."""
    changes, views = [], []
    for i in range(TIMED):
        member = members[i % len(members)]
        started = time.perf_counter()
        deformed = surrogate.at({**member.parameters, **settings[i % len(settings)]})
        between = time.perf_counter()
        deformed.render(member.cameras[i * len(member.cameras) // TIMED])
        views.append(time.perf_counter() - between)
        changes.append(between - started)
    return Milliseconds.of(changes), Milliseconds.of(views)
