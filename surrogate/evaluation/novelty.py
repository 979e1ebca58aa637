"""Novelty of a transfer function: the share of what it makes visible that no trained function showed.

A field value fills some share of a member's volume, known from the histogram in the sidecar. A function gives the value
an extinction. Their product is the visible amount of that value. It is new as far as no trained function showed at
least a quarter of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering, field_of
from surrogate.appearance.averages import MOST_OPAQUE
from surrogate.model import Surrogate

MAGNIFIED = 4.0  # times the trained extinction, up to which a value counts as shown by training
SAMPLES = 8  # samples of a function within a bin of the histogram


@dataclass(frozen=True, eq=False, repr=False)
class SeenValues:
    """Visibility of every field value in training.

    Attributes
    ----------
    edges : (K + 1,) field values; the first and the last bin hold values beyond the members' histograms.
    frequency : (K,) shares of the volume, mean over members.
    extinctions : (K,) per world unit, the largest of all trained functions.
    """

    edges: NDArray[np.float64]  # [K + 1]
    frequency: NDArray[np.float64]  # [K]
    extinctions: NDArray[np.float64]  # [K]

    @classmethod
    def of(cls, summaries: Sequence[FieldSummary], functions: Sequence[TransferFunction]) -> SeenValues | None:
        """Values that `functions` show of members with these summaries, whose histograms have equal bins; None if
        either is empty."""
        if not summaries or not functions:
            return None
        inner = summaries[0].bin_edges
        low, high = (
            min(inner[0], *(s.minimum for s in summaries)),
            max(inner[-1], *(s.maximum for s in summaries)),
        )
        edges = np.array([low, *inner, high])  # [K + 1]
        frequency = np.mean([_shares(summary) for summary in summaries], axis=0)  # [K]
        return cls(edges, frequency, np.max([extinctions(function, edges) for function in functions], axis=0))

    @classmethod
    def of_training(cls, catalog: Catalog, surrogate: Surrogate) -> SeenValues | None:
        """Values that the training of `surrogate` showed of its training members in `catalog`.

        None where no training image is a volume rendering, or the members have no summaries.
        """
        functions, field = trained_functions(catalog, surrogate)
        learnt = [member.summary(field) for member in catalog.members if member.split == "train"] if functions else []
        return cls.of([summary for summary in learnt if summary is not None], functions)

    def visible(self, function: TransferFunction) -> NDArray[np.float64]:
        """Share of each bin (K,) in the visible amount under `function`; zeros where it shows nothing."""
        opacities = self.frequency * extinctions(function, self.edges)  # [K]
        return opacities / total if (total := float(opacities.sum())) > 0.0 else opacities

    def novelty(self, function: TransferFunction) -> float:
        """Share, 0 to 1, of the visible amount under `function` that training did not show; 0 if it shows nothing."""
        extinction = extinctions(function, self.edges)  # [K]
        total = float(self.frequency @ extinction)
        new = np.maximum(extinction - MAGNIFIED * self.extinctions, 0.0)  # [K]
        return float(self.frequency @ new) / total if total > 0.0 else 0.0

    def quantile(self, function: TransferFunction, share: float) -> float:
        """The field value below which `share` of the visible amount lies; raises ValueError where `function` shows nothing."""
        cumulative = np.concatenate([[0.0], np.cumsum(self.visible(function))])  # [K + 1]
        if cumulative[-1] <= 0.0:
            raise ValueError(f"{function} shows nothing of these members, so it has no quantiles")
        return float(np.interp(share, cumulative, self.edges))


def trained_functions(catalog: Catalog, surrogate: Surrogate) -> tuple[list[TransferFunction], str]:
    """The trained transfer functions, that of the base first, and the name of the field that they show.

    Empty where the base appearance is another kind than a volume rendering.
    """
    renderings = {a.name: a for a in catalog.plan.appearances if isinstance(a, VolumeRendering)}
    base = renderings.get(str(surrogate.training.get("appearance", "")))
    if base is None:
        return [], ""
    variations = [v for v in surrogate.variations if v.edits_base]
    names = [base.name, *(name for v in variations if v.base == base.name for name in v.named("train"))]
    return [renderings[name].transfer_function for name in names if name in renderings], field_of(base)


def extinctions(function: TransferFunction, edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means (K,) of the extinction per world unit over bins with these edges (K + 1,)."""
    inside = (np.arange(SAMPLES) + 0.5) / SAMPLES  # [S]
    values = edges[:-1, None] + np.diff(edges)[:, None] * inside  # [K, S]
    opacities = np.minimum(function.opacities(values), MOST_OPAQUE)  # [K, S]
    return np.asarray(-np.log1p(-opacities).mean(axis=1) / function.opacity_unit_distance, dtype=np.float64)


def _shares(summary: FieldSummary) -> NDArray[np.float64]:
    """Shares (K,) of a member's volume below, in the bins of, and above its histogram."""
    counted = float(summary.histogram.sum())
    inside = summary.histogram * ((1.0 - summary.clipped_fraction) / counted) if counted else 0.0 * summary.histogram
    below, above = summary.minimum < summary.bin_edges[0], summary.maximum > summary.bin_edges[-1]
    # Their side is unknown: half of them go to each side, where both exist.
    end = summary.clipped_fraction / max(1, below + above)
    return np.array([end * below, *inside, end * above])
