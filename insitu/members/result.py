"""The result of rendering one member, and the memory that it took."""

from __future__ import annotations

import math
import resource
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from catalogs.store.sizes import Sizes
from catalogs.vocabulary.quantity import Quantity

_STATUS = Path("/proc/self/status")
# getrusage counts kibibytes on Linux and bytes on macOS.
_HIGH_WATER_UNIT = 1 if sys.platform == "darwin" else 1024


@dataclass(frozen=True)
class RenderedMember:
    """The images and the cost of one rendered member, or the reason why it has none: skipped, queued or failed.

    Attributes
    ----------
    name, path : the member and its directory in the catalog.
    images : how many images were written.
    render_seconds, write_seconds, seconds : drawing, encoding and storing, and everything together.
    extra_memory : bytes of resident memory the call added at its peak (see `PeakMemory`).
    ranges : smallest and largest finite value of each field that is shown, by name; "" for a single one without a name.
    clipped_fractions : share of each field's values outside the ensemble's value range, likewise.
    sizes : bytes of images and of coarse fields.
    warnings : what was recorded with the member besides: parameters out of bounds, transparent values.
    quantities : what each field is called, and its unit, as far as the catalog knows.
    skipped : whether it was in the catalog already, and nothing was done.
    error : why the member is missing; "" where it is not.
    queued : whether it is yet to be rendered, in the background.

    Examples
    --------
    >>> import insitu
    >>> from blobs import APPEARANCE, PLACE, simulate
    >>> plan = {"space": {"separation": (0.6, 1.0)}, "appearances": APPEARANCE, "views": insitu.ViewPlan(1, 32, 32)}
    >>> member = insitu.render_member(simulate(0.8, 0.3), {"separation": 0.8}, catalog="one.cdb", **plan, **PLACE)
    >>> member
    RenderedMember separation-0.8: 12 images in ...
    >>> "{:.2f} to {:.2f}".format(*member.range)
    '0.00 to 0.96'
    """

    name: str
    path: Path
    images: int = 0
    render_seconds: float = 0.0
    write_seconds: float = 0.0
    seconds: float = 0.0
    extra_memory: int = 0
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    clipped_fractions: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    sizes: Sizes = Sizes()  # noqa: RUF009 - frozen
    skipped: bool = False
    error: str = ""
    queued: bool = False

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest finite value of the first field; NaN where nothing was rendered."""
        return next(iter(self.ranges.values()), (math.nan, math.nan))

    @property
    def clipped_fraction(self) -> float:
        """Share of the first field's values outside the ensemble's value range; NaN where nothing was rendered."""
        return next(iter(self.clipped_fractions.values()), math.nan)

    @property
    def images_per_second(self) -> float:
        return self.images / self.seconds if self.seconds else 0.0

    def __repr__(self) -> str:
        if self.error:
            return f"RenderedMember {self.name}: missing, {self.error}"
        if self.queued:
            return f"RenderedMember {self.name}: to be rendered in the background"
        if self.skipped:
            return f"RenderedMember {self.name}: skipped, it was in the catalog already"
        return (
            f"RenderedMember {self.name}: {self.images} images in {self.seconds:.1f} s "
            f"({self.images_per_second:.0f}/s; render {self.render_seconds:.1f} s, write {self.write_seconds:.1f} s), "
            f"{self.extra_memory / 1e6:.0f} MB extra memory"
        )

    def __str__(self) -> str:
        lines = [
            repr(self),
            *(self._range_line(name) for name in self.ranges),
            *([f"  {self.sizes}"] if self.sizes.images else []),
            *([f"  {self.sizes.advice}"] if self.sizes.advice else []),
            *([] if self.error else [f"  {self.path}"]),
        ]
        return "\n".join([*lines, *(f"  warning: {w}" for w in self.warnings)])

    def _range_line(self, name: str) -> str:
        (low, high), of = self.ranges[name], self.quantities.get(name, Quantity(name))
        between = f"{low:.6g} to {high:.6g} {of.unit}".rstrip()
        return f"  {of.name or 'values'} {between}, {100 * self.clipped_fractions[name]:.2f} % clipped"


class PeakMemory:
    """The largest resident memory seen since it was made, beyond what was resident then, in bytes.

    `sample` looks at the resident size now, so a peak between two samples may be missed.  Where the process rose above its own
    previous high-water mark, the kernel's figure is taken instead and nothing is missed.  Memory that other parts of the process
    take or free meanwhile counts, too.
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
