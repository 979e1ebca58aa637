"""What rendering one member wrote, what it cost, and what its fields held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RenderedMember:
    """What rendering one member wrote and what it cost.

    Attributes
    ----------
    name, path : the member and its directory in the catalog.
    images : how many images were written.
    render_seconds, write_seconds, seconds : drawing, encoding and storing, and everything together.
    extra_memory : bytes of resident memory the call added at its peak (see `insitu.memory.PeakMemory`).
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
