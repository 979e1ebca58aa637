"""What rendering one member wrote, what it cost, and what its fields held."""

from __future__ import annotations

import resource
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import psutil

_STATUS = Path("/proc/self/status")
# getrusage counts kibibytes on Linux and bytes on macOS.
_HIGH_WATER_UNIT = 1 if sys.platform == "darwin" else 1024


@dataclass(frozen=True)
class RenderedMember:
    """What rendering one member wrote and what it cost.

    Attributes
    ----------
    name, path : the member and its directory in the catalog.
    images : how many images were written.
    render_seconds, write_seconds, seconds : drawing, encoding and storing, and everything together.
    extra_memory : bytes of resident memory the call added at its peak (see `PeakMemory`).
    ranges : smallest and largest finite value of each field that is shown, by name; "" for an only one without a name.
    clipped_fractions : share of each field's values outside the ensemble's value range, likewise.
    warnings : what was recorded with the member besides: parameters out of bounds, transparent values.
    """

    name: str
    path: Path
    images: int
    render_seconds: float
    write_seconds: float
    seconds: float
    extra_memory: int
    ranges: Mapping[str, tuple[float, float]]
    clipped_fractions: Mapping[str, float]
    warnings: tuple[str, ...] = ()

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest finite value of the first field."""
        return next(iter(self.ranges.values()))

    @property
    def clipped_fraction(self) -> float:
        """Share of the first field's values outside the ensemble's value range."""
        return next(iter(self.clipped_fractions.values()))

    @property
    def images_per_second(self) -> float:
        return self.images / self.seconds

    def __repr__(self) -> str:
        return (
            f"RenderedMember {self.name}: {self.images} images in {self.seconds:.1f} s "
            f"({self.images_per_second:.0f}/s; render {self.render_seconds:.1f} s, write {self.write_seconds:.1f} s), "
            f"{self.extra_memory / 1e6:.0f} MB extra memory"
        )

    def __str__(self) -> str:
        lines = [
            repr(self),
            *(
                f"  {name or 'values'} {low:.6g} to {high:.6g}, {100 * self.clipped_fractions[name]:.2f} % clipped"
                for name, (low, high) in self.ranges.items()
            ),
            f"  {self.path}",
        ]
        return "\n".join([*lines, *(f"  warning: {w}" for w in self.warnings)])


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
