"""Values of pilot members' fields, for transfer functions that are fixed before the first member is rendered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import plural
from render.datasets import to_grid

SAMPLES = 200_000  # values kept per member: quantiles to about 0.1 %
QUANTILES = (0.001, 0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 0.999)
BAR = 40


@dataclass(frozen=True, eq=False)
class Probe:
    """The pooled values of pilot members, each weighing the same.

    Attributes
    ----------
    names : (K,) the members looked at.
    ranges : (K, 2) smallest and largest value of each.
    values : (K, S) values drawn evenly from each.
    """

    names: tuple[str, ...]
    ranges: NDArray[np.float64]  # [K, 2]
    values: NDArray[Any]  # [K, S]

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value of all."""
        return float(self.ranges[:, 0].min()), float(self.ranges[:, 1].max())

    def quantile(self, fraction: float) -> float:
        """The value below which this fraction of the pooled values lies."""
        return float(np.quantile(self.values, fraction))

    def histogram(self, bins: int, low: float, high: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Fractions (K, bins) of each member's values per bin, and bin edges (bins + 1,), over [low, high]."""
        edges = np.linspace(low, high, bins + 1)
        counts = np.stack([np.histogram(values, bins=edges)[0] for values in self.values])  # [K, bins]
        return counts / self.values.shape[1], edges

    def __repr__(self) -> str:
        low, high = self.range
        return f"Probe({plural(len(self.names), 'member')}, values {low:.6g} to {high:.6g}, median {self.quantile(0.5):.6g})"

    def __str__(self) -> str:
        low, high = self.range
        lines = [f"{plural(len(self.names), 'member')}, values {low:.6g} to {high:.6g}", "quantiles"]
        lines += [f"  {100 * q:5.1f} %  {self.quantile(q):.6g}" for q in QUANTILES]
        inner_low, inner_high = self.quantile(QUANTILES[0]), self.quantile(QUANTILES[-1])
        if inner_low < inner_high:
            histograms, edges = self.histogram(24, inner_low, inner_high)
            fractions = histograms.mean(axis=0)
            lines.append("histogram from the first to the last of these quantiles")
            for fraction, edge in zip(fractions, edges[:-1], strict=True):
                bar = "#" * round(BAR * fraction / fractions.max())
                lines.append(f"  {edge:12.5g}  {100 * fraction:5.1f} %  {bar}")
        lines.append("range by member")
        lines += [f"  {name:<16} {a:.6g} to {b:.6g}" for name, (a, b) in zip(self.names, self.ranges, strict=True)]
        return "\n".join(lines)


def probe_fields(fields: Mapping[str, Any] | Iterable[Any], *, nan: str = "refuse") -> Probe:
    """Pool the values of pilot members.

    Parameters
    ----------
    fields : anything `to_grid` takes, by member name or in a row; taken one at a time, so they may be a generator.
    nan : as in `render_member`; holes are left out.

    Examples
    --------
    >>> import insitu
    >>> from blobs import simulate
    >>> probe = insitu.probe_fields({"near": simulate(0.6, 0.3), "far": simulate(1.0, 0.3)})
    >>> "{:.2f} to {:.2f}".format(*probe.range)
    '0.00 to 0.98'
    >>> f"{probe.quantile(0.99):.2f}"  # a transfer function may be opaque from here on
    '0.59'
    """
    named = fields.items() if isinstance(fields, Mapping) else ((f"member {i}", f) for i, f in enumerate(fields))
    names, ranges, samples = [], [], []
    rng = np.random.default_rng(0)
    for name, data in named:
        grid = to_grid(data, nan=nan, warn=False)
        values = grid.values.ravel() if grid.holes is None else grid.values[~grid.holes]
        names.append(name)
        ranges.append((float(values.min()), float(values.max())))
        samples.append(rng.choice(values, SAMPLES) if values.size > SAMPLES else np.resize(values, SAMPLES))
    if not names:
        raise ValueError("there is no member to probe")
    return Probe(tuple(names), np.array(ranges), np.stack(samples))
