"""The time that a fit is given: this process's share of the processors, whatever else the machine does."""

from __future__ import annotations

import time
from collections.abc import Callable

from surrogate.settings import TrainingSettings
from surrogate.splatting.device import chosen


def clock(settings: TrainingSettings) -> Callable[[], float]:
    """Seconds since some moment: of all cores together on a CPU, and on the wall where a GPU computes.

    Two cores that compute for a minute count as two, so a study is best given one core (`taskset`, or a batch system's affinity):
    it then takes as long as it says, and as many can run side by side as there are cores.
    """
    return time.process_time if chosen(settings.device).type == "cpu" else time.perf_counter
