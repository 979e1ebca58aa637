"""Members predicted without themselves: the number of components, and standard deviations that hold for unseen members."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import one_line
from surrogate.appearance.scale import ValueScale
from surrogate.emulation.components import PIECE, Array, Components, without
from surrogate.emulation.measures import DRAWS, NUMBERS, box_numbers
from surrogate.emulation.processes import Processes

FOLDS = 10
SHARE, NORMAL = 0.9, 1.6448536269514722  # intervals that are made to hold, and half their width in standard deviations
# Components are kept until the squared error without a member is this little above the least: the rest is storage.
EXCESS = 0.01
TINY = 1e-12  # of the mean square: less is rounding
SEED = 0


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Members' fields predicted by emulators that were fitted anew without a tenth of the members, theirs among them.

    Everything is a combination of the M members' differences from their mean.

    Attributes
    ----------
    remainders : (M, M) the true fields less the predicted.
    folds : (M,) the emulator that each member was predicted by.
    components : (F, K, M) components of each emulator.
    deviations : (M, K) standard deviations of the coefficients.
    """

    remainders: Array  # [M, M]
    folds: NDArray[np.int64]  # [M]
    components: Array  # [F, K, M]
    deviations: Array  # [M, K]

    __repr__ = one_line

    @classmethod
    def of(cls, points: Array, products: Array, processes: Processes, count: int) -> LeftOut:
        """For points (M, P) and inner products (M, M); `processes` of all members are where fits start from."""
        members = len(points)
        folds = folds_of(members)
        remainders, deviations = np.eye(members), np.zeros((members, count))
        combined = np.zeros((folds.max() + 1, count, members))
        for fold, components in enumerate(combined):
            out, learnt = np.flatnonzero(folds == fold), np.flatnonzero(folds != fold)
            remainders[out], combinations, spreads = predicted_by(learnt, out, points, products, processes, count)
            few = len(combinations)
            components[:few, learnt] = combinations
            deviations[out, :few] = spreads
        return cls(remainders, folds, combined, deviations)

    def squared(self, products: Array) -> Array:
        """The sum of squared errors of each member, (M,)."""
        return squared(self.remainders, products)

    def tails(self, products: Array, combinations: Array) -> Array:
        """The part (M, M) of the remainders that the components of `combinations` (M, K) can't express."""
        return self.remainders - (self.remainders @ products @ combinations) @ combinations.T

    def factor(self, differences: Array, tails: Array) -> float:
        """The factor on standard deviations with which nine tenths of the errors at places (M, N) lie in 90 % intervals.

        Each member's own tail is left out of the mean square of the tails that its errors are compared with.
        """
        errors = np.abs(self.remainders @ differences)  # [M, N]
        squares = (tails @ differences) ** 2  # [M, N]
        others = (squares.sum(0) - squares) / (len(errors) - 1)  # [M, N]
        ratios = np.zeros_like(errors)
        for fold, combinations in enumerate(self.components):
            out = self.folds == fold
            components = combinations @ differences  # [K, N]
            expected = np.sqrt(self.deviations[out] ** 2 @ components**2 + np.maximum(others[out], 0.0))  # [O, N]
            ratios[out] = np.divide(errors[out], expected, out=np.zeros_like(expected), where=expected > 0.0)
        return float(np.quantile(ratios, SHARE)) / NORMAL

    def number_factors(
        self, mean: NDArray[np.float32], differences: NDArray[np.float32], factor: float, scale: ValueScale | None
    ) -> dict[str, float]:
        """Factors on standard deviations of `NUMBERS` with which 90 % intervals hold for members that were left out.

        Fields are `mean` (B, N) and `differences` (M, B, N) from it, on `scale`, at places in B parts of the box; `factor` is that
        of coefficients.  Intervals hold for the whole box and for its parts.  The quantile is the one of conformal prediction (Lei
        et al. 2018, "Distribution-free predictive inference for regression", section 2.2), or of fewer than nine members the
        greatest, which holds for M of M + 1.
        """
        members, count = self.deviations.shape
        normal = np.random.default_rng(SEED).standard_normal((DRAWS, count))
        level = float(np.median(mean + differences))
        flat = differences.reshape(members, -1)  # [M, B N]
        ratios = np.zeros((members, len(mean) + 1, len(NUMBERS)))  # of the parts, and of the whole
        for fold, combinations in enumerate(self.components):
            components = combinations.astype(np.float32) @ flat  # [K, B N]
            for member in np.flatnonzero(self.folds == fold):
                truth = mean.ravel() + flat[member]  # [B N]
                predicted = truth - self.remainders[member].astype(np.float32) @ flat  # [B N]
                coefficients = (normal * self.deviations[member] * factor).astype(np.float32)  # [D, K]
                fields = np.vstack([truth, predicted, predicted + coefficients @ components])  # [2 + D, B N]
                parts = box_numbers(fields.reshape(-1, *mean.shape), level)  # [2 + D, B, 4]
                whole = [parts[..., 0].min(1), parts[..., 1].max(1), *parts[..., 2:].mean(1).T]
                numbers = np.concatenate([parts, np.stack(whole, -1)[:, None]], 1)  # [2 + D, B + 1, 4]
                if scale is not None:  # which keeps the order of values
                    numbers[..., :2] = scale.values(numbers[..., :2])
                spread = np.sqrt(((numbers[2:] - numbers[1]) ** 2).mean(0))
                off = np.abs(numbers[1] - numbers[0])
                ratios[member] = np.divide(off, spread, out=np.zeros_like(off), where=spread > 0.0)
        rank = conformal_rank(members)
        ordered = np.sort(ratios[:, :-1].reshape(-1, len(NUMBERS)), axis=0), np.sort(ratios[:, -1], axis=0)
        factors = np.maximum(ordered[0][rank * len(mean) - 1], ordered[1][rank - 1]) / NORMAL
        return {name: float(f) if f > 0.0 else 1.0 for name, f in zip(NUMBERS, factors, strict=True)}


def folds_of(members: int) -> NDArray[np.int64]:
    """The tenth (M,) that each member is left out with."""
    return np.random.default_rng(SEED).permutation(members) % min(FOLDS, members)


def conformal_rank(count: int) -> int:
    """The rank among `count` residuals of the one that nine in ten further ones are not above.

    Lei et al. 2018, "Distribution-free predictive inference for regression", section 2.2.  Of fewer than nine it is the
    greatest, which holds for n of n + 1.
    """
    return min(math.ceil((count + 1) * SHARE - TINY), count)


def predicted_by(
    learnt: NDArray[np.int64],
    out: NDArray[np.int64],
    points: Array,
    products: Array,
    start: Processes | None = None,
    count: int | None = None,
) -> tuple[Array, Array, Array]:
    """Some members `out` (O,) of M predicted by an emulator of the members `learnt` (L,), by at most `count` components.

    Returns remainders (O, M), components (K, L) and standard deviations of their coefficients (O, K).  Without a `count` as many
    components are taken as are `needed`; fits begin at the processes `start`.
    """
    own = Components.of(without(products, learnt))
    fitted = Processes.fit(points[learnt], own.coefficients, start)
    few = needed(own.coefficients, fitted.left_out()) if count is None else min(count, own.coefficients.shape[1])
    means, spreads = fitted.predict(points[out])  # [O, J]
    combinations = own.combinations[:, :few] - own.combinations[:, :few].mean(0)  # [L, K]
    remainders = np.zeros((len(out), len(points)))
    remainders[np.arange(len(out)), out] = 1.0
    remainders[:, learnt] -= 1.0 / len(learnt) + means[:, :few] @ combinations.T
    return remainders, combinations.T, spreads[:, :few]


def squared(remainders: Array, products: Array) -> Array:
    """The sums of squares (O,) of remainders (O, M)."""
    return np.maximum(np.einsum("im,ml,il->i", remainders, products, remainders, optimize=True), 0.0)


def residual_of(tails: Array, differences: NDArray[np.float32]) -> NDArray[np.float32]:
    """The root mean square (V,) of tails (M, M) of the members' differences (M, V)."""
    residuals = np.empty(differences.shape[1], dtype=np.float32)
    for start in range(0, len(residuals), PIECE):
        piece = (tails.astype(np.float32) @ differences[:, start : start + PIECE]).astype(np.float64)  # [M, piece]
        residuals[start : start + PIECE] = np.sqrt((piece**2).mean(0))
    return residuals


def needed(coefficients: Array, left_out: Array) -> int:
    """The least number of components whose leave-one-out error is nearly the least, by errors (M, J) of the coefficients.

    The geometric mean over members counts: it is what mean decibels show, and no single strange member decides.
    """
    nothing = np.zeros((len(coefficients), 1))
    own = np.cumsum(np.hstack([nothing, left_out**2]), 1)  # [M, J + 1]
    missing = np.cumsum(np.hstack([nothing, coefficients[:, ::-1] ** 2]), 1)[:, ::-1]  # [M, J + 1]
    totals = np.log(own + missing + TINY * (coefficients**2).sum(1).mean() + np.finfo(float).tiny).mean(0)  # [J + 1]
    return int(np.flatnonzero(totals <= totals.min() + np.log1p(EXCESS))[0])
