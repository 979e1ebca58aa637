"""How much memory a call adds to the process that makes it."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import psutil

_STATUS = Path("/proc/self/status")
# getrusage counts kibibytes on Linux and bytes on macOS.
_HIGH_WATER_UNIT = 1 if sys.platform == "darwin" else 1024


class PeakMemory:
    """The largest resident memory seen since it was made, beyond what was resident then, in bytes.

    `sample` looks at the resident size now, so what comes and goes between two samples may be missed; where the
    process rose above its own previous high-water mark, the kernel's figure is taken instead and nothing is missed.
    """

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._start = self._process.memory_info().rss
        self._high_water = _high_water()
        self._peak = self._start

    def sample(self) -> None:
        self._peak = max(self._peak, self._process.memory_info().rss)

    @property
    def extra_bytes(self) -> int:
        self.sample()
        now = _high_water()
        peak = max(self._peak, now) if now > self._high_water else self._peak
        return peak - self._start


def _high_water() -> int:
    """Bytes.  Linux's own figure is preferred: getrusage's begins with what the parent process held at the fork."""
    if _STATUS.is_file():
        for line in _STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _HIGH_WATER_UNIT
