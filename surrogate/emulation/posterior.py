"""The distribution of an emulated field: coefficients of modes, each with its standard deviation, and what modes leave."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import one_line
from surrogate.appearance.scale import ValueScale
from surrogate.emulation.corners import Corners, Shape, resampled

PLACES_AT_ONCE = 4_096
VOXELS_AT_ONCE = 1 << 15


@dataclass(frozen=True, eq=False)
class Posterior:
    """A distribution of fields of V samples, on a scale of values.

    Attributes
    ----------
    mean : (V,) of the ensemble.
    modes : (K, V), which the coefficients are of.
    residual : (V,) standard deviations of what no coefficient expresses.
    scale : of all of these; None: the field's unit.
    coefficients, spreads : (K,) means and standard deviations.
    factors : on standard deviations of a box's numbers, by name, see `LeftOut.number_factors`.
    """

    mean: NDArray[np.float32]  # [V]
    modes: NDArray[np.float32]  # [K, V]
    residual: NDArray[np.float32]  # [V]
    scale: ValueScale | None
    coefficients: NDArray[np.float64]  # [K]
    spreads: NDArray[np.float64]  # [K]
    factors: Mapping[str, float] = field(default_factory=dict)

    __repr__ = one_line

    def values(self) -> NDArray[np.float32]:
        """The most likely field (V,), in the field's unit."""
        return self._in_unit(self._scaled(self.coefficients))

    def deviations(self) -> NDArray[np.float32]:
        """Standard deviations (V,) in the field's unit."""
        deviations = np.empty(len(self.mean), dtype=np.float32)
        unit = max(self.spreads.max(initial=0.0), float(self.residual.max(initial=0.0))) or 1.0  # squares stay small
        squares = ((self.spreads / unit) ** 2).astype(np.float32)  # [K]
        center = self._scaled(self.coefficients)  # [V]
        for start in range(0, len(deviations), VOXELS_AT_ONCE):
            piece = slice(start, start + VOXELS_AT_ONCE)
            scaled = (
                np.sqrt(squares @ self.modes[:, piece] ** 2 + (self.residual[piece] / np.float32(unit)) ** 2) * unit
            )
            deviations[piece] = self._half_width(center[piece], scaled)
        return deviations

    def draws(self, count: int, seed: int) -> Iterator[NDArray[np.float32]]:
        """`count` fields (V,) of the distribution, without what no coefficient expresses."""
        random = np.random.default_rng(seed)
        for _ in range(count):
            yield self._in_unit(
                self._scaled(self.coefficients + self.spreads * random.standard_normal(len(self.spreads)))
            )

    def sample(
        self, corners: Corners, holes: NDArray[np.bool_] | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Values and standard deviations (N,) at the corners' places, in the field's unit."""
        values, deviations = np.empty(len(corners.indices)), np.empty(len(corners.indices))
        for start in range(0, len(values), PLACES_AT_ONCE):
            piece = slice(start, start + PLACES_AT_ONCE)
            some = Corners(corners.indices[piece], corners.weights[piece])
            values[piece], deviations[piece] = self._sampled(some, holes)
        return values, deviations

    def _sampled(
        self, corners: Corners, holes: NDArray[np.bool_] | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        indices, inverse = np.unique(corners.indices, return_inverse=True)  # [U]
        near = Corners(inverse.reshape(corners.indices.shape), corners.weights)
        modes = self.modes[:, indices].astype(np.float64)  # [K, U]
        scaled = self.mean[indices] + self.coefficients @ modes  # [U]
        values = near.average(self._in_unit(scaled, np.float64), None if holes is None else holes[indices])
        spread = np.sqrt(self.spreads**2 @ modes**2 + self.residual[indices].astype(np.float64) ** 2)  # [U]
        slopes = np.divide(self._half_width(scaled, spread), spread, out=np.ones_like(spread), where=spread > 0.0)
        by_mode = near.average(modes * slopes)  # [K, N]
        residual = near.average(self.residual[indices] * slopes)  # [N]
        deviations = np.sqrt(self.spreads**2 @ by_mode**2 + residual**2)
        return values, np.where(np.isnan(values), np.nan, deviations)

    def parts(self) -> Iterator[NDArray[np.float32]]:
        """Fields (V,) in the field's unit, independent of each other: their squares add up to the variance."""
        slopes: Any = 1.0
        if self.scale is not None:
            spread = replace(self, scale=None).deviations()
            slopes = np.divide(self.deviations(), spread, out=np.ones_like(spread), where=spread > 0.0)
        for spread, mode in zip(self.spreads.astype(np.float32), self.modes, strict=True):
            yield spread * mode * slopes
        yield self.residual * slopes

    def _scaled(self, coefficients: NDArray[np.float64]) -> NDArray[np.float32]:
        return self.mean + coefficients.astype(np.float32) @ self.modes

    def _in_unit(self, scaled: NDArray[np.floating], form: type = np.float32) -> NDArray[np.floating]:
        return scaled if self.scale is None else self.scale.values(scaled).astype(form)

    def _half_width(self, scaled: NDArray[np.floating], spread: NDArray[np.floating]) -> NDArray[np.floating]:
        """Half the width in the field's unit of `spread` on either side, which steps of the scale within it share."""
        if self.scale is None:
            return spread
        return (self.scale.values(scaled + spread) - self.scale.values(scaled - spread)) / 2.0


@dataclass(frozen=True, eq=False)
class ResampledPosterior:
    """A distribution of fields on `after` samples (Z, Y, X) instead of `before`, over the same box: trilinear."""

    posterior: Posterior | ResampledPosterior
    before: Shape
    after: Shape

    __repr__ = one_line

    @property
    def factors(self) -> Mapping[str, float]:
        """See `Posterior`."""
        return self.posterior.factors

    def values(self) -> NDArray[np.float32]:
        """The most likely field (V,), in the field's unit."""
        return self._resampled(self.posterior.values())

    def deviations(self) -> NDArray[np.float32]:
        """Standard deviations (V,) in the field's unit."""
        return np.sqrt(sum(part**2 for part in self.parts()))

    def draws(self, count: int, seed: int) -> Iterator[NDArray[np.float32]]:
        """See `Posterior.draws`."""
        return map(self._resampled, self.posterior.draws(count, seed))

    def sample(
        self, corners: Corners, holes: NDArray[np.bool_] | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Values and standard deviations (N,) at the corners' places, in the field's unit."""
        values = corners.average(self.values(), holes)
        deviations = np.sqrt(sum(corners.average(part) ** 2 for part in self.parts()))
        return values, np.where(np.isnan(values), np.nan, deviations)

    def parts(self) -> Iterator[NDArray[np.float32]]:
        """See `Posterior.parts`."""
        return map(self._resampled, self.posterior.parts())

    def _resampled(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        return resampled(values.reshape(self.before), self.after).ravel()
