"""Gaussian processes over parameters: Matérn 5/2, one length scale a parameter, noise by marginal likelihood.

Rasmussen & Williams 2006, chapters 2, 4 and 5.  Written here rather than taken from a library: processes share length scales in
groups here, and scikit-learn has neither derivatives nor leave-one-out errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular

from catalogs.vocabulary.words import one_line

Array = NDArray[np.float64]

ROOT = np.sqrt(5.0)
# Length scales, where the bounds of a parameter lie 2 apart; and noise, as a share of the variance.
LENGTHS, NOISES = (0.1, 100.0), (1e-8, 1.0)
# Logarithms of length scales are about that of the whole range before data are seen: few members then fit no noise.
USUAL_LENGTH, USUAL_FACTOR = 2.0, np.e
FIRST_NOISE = 1e-3
# The strongest coefficients have length scales of their own; the others share, from these on.
SHARED_FROM = (12, 30)
MOST_STEPS = 60
MOST_FITTED = 256  # members that decide on length scales: time grows with their cube
SEED = 0


@dataclass(frozen=True, eq=False)
class Processes:
    """K processes through the coefficients of M members, which share length scales and noise in G groups.

    Attributes
    ----------
    points : (M, P), of the members.
    coefficients : (M, K), about 0.
    lengths : (G, P) length scales.
    noises : (G,) variances of the noise, as shares of the process's.
    groups : (K,) the group of each.
    """

    points: Array  # [M, P]
    coefficients: Array  # [M, K]
    lengths: Array  # [G, P]
    noises: Array  # [G]
    groups: NDArray[np.int64]  # [K]

    __repr__ = one_line

    @classmethod
    def fit(cls, points: Array, coefficients: Array, start: Processes | None = None) -> Processes:
        """The processes of the greatest marginal likelihood, from `start` on; strongest coefficients first.

        In a group each counts by its variance, so what is mostly noise does not decide.
        """
        count = coefficients.shape[1]
        ends = [*range(1, SHARED_FROM[0] + 1), *SHARED_FROM[1:], count]
        bounds = [e for e in sorted(set(ends)) if 0 < e <= count]
        groups = np.searchsorted(bounds, np.arange(count), side="right")  # [K]
        some = np.random.default_rng(SEED).permutation(len(points))[:MOST_FITTED]
        squares = _squares(points[some], points[some])
        optima = []
        for group in range(len(bounds)):
            first = None
            if start is not None and group < len(start.noises):
                first = np.append(np.log(start.lengths[group]), np.log(start.noises[group]))
            optima.append(_most_likely(squares, coefficients[np.ix_(some, groups == group)], first))
        hyper = np.exp(np.reshape(optima, (len(bounds), points.shape[1] + 1)))  # [G, P + 1]
        return cls(points, coefficients, hyper[:, :-1], hyper[:, -1], groups)

    def first(self, count: int) -> Processes:
        """The first `count` of them."""
        groups = self.groups[:count]
        used = int(groups.max()) + 1 if count else 0
        return Processes(self.points, self.coefficients[:, :count], self.lengths[:used], self.noises[:used], groups)

    @cached_property
    def factors(self) -> list[Array]:
        """The lower Cholesky factor of each group's covariance of the members, over the variance, G of (M, M)."""
        return [_factor(self._covariance(g, self.points, self.points), n) for g, n in enumerate(self.noises)]

    @cached_property
    def weights(self) -> Array:
        """(M, K): a mean is the covariances with the members times these."""
        weights = np.zeros_like(self.coefficients)
        for group, factor in enumerate(self.factors):
            mine = self.groups == group
            weights[:, mine] = cho_solve((factor, True), self.coefficients[:, mine])
        return weights

    @cached_property
    def variances(self) -> Array:
        """The most likely variance of each process, (K,)."""
        return np.einsum("mk,mk->k", self.coefficients, self.weights) / max(len(self.points), 1)

    def means(self, points: Array) -> Array:
        """Means (N, K) at points (N, P)."""
        means = np.zeros((len(points), self.coefficients.shape[1]))
        for group in range(len(self.noises)):
            mine = self.groups == group
            means[:, mine] = self._covariance(group, points, self.points) @ self.weights[:, mine]
        return means

    def predict(self, points: Array) -> tuple[Array, Array]:
        """Means and standard deviations (N, K) at points (N, P), without the noise."""
        means = np.zeros((len(points), self.coefficients.shape[1]))
        shares = np.ones_like(means)
        for group, factor in enumerate(self.factors):
            mine = self.groups == group
            covariance = self._covariance(group, points, self.points)  # [N, M]
            means[:, mine] = covariance @ self.weights[:, mine]
            explained = (solve_triangular(factor, covariance.T, lower=True) ** 2).sum(0)  # [N]
            shares[:, mine] = np.clip(1.0 - explained, 0.0, 1.0)[:, None]
        return means, np.sqrt(shares * self.variances)

    def derivative(self, point: Array) -> Array:
        """Derivatives (P, K) of the means at a point (P,) by its parameters."""
        slopes = np.zeros((len(point), self.coefficients.shape[1]))
        for group, lengths in enumerate(self.lengths):
            mine = self.groups == group
            differences = (point - self.points) / lengths**2  # [M, P]
            _, slope = _matern(_squares(point[None], self.points), lengths)  # [1, M]
            slopes[:, mine] = -(differences * slope[0, :, None]).T @ self.weights[:, mine]
        return slopes

    def left_out(self) -> Array:
        """Each member's coefficients less their prediction without it, (M, K), equation 5.12; length scales stay."""
        errors = np.zeros_like(self.coefficients)
        for group, factor in enumerate(self.factors):
            mine = self.groups == group
            inverse = cho_solve((factor, True), np.eye(len(factor)))
            errors[:, mine] = self.weights[:, mine] / np.diag(inverse)[:, None]
        return errors

    def left_out_shares(self) -> Array:
        """The share (M, K) of each process's variance that stays open at a member without it, equation 5.12, without the noise."""
        shares = np.zeros_like(self.coefficients)
        for group, (factor, noise) in enumerate(zip(self.factors, self.noises, strict=True)):
            inverse = cho_solve((factor, True), np.eye(len(factor)))
            open_here = np.clip(1.0 / np.diag(inverse) - noise, 0.0, 1.0)  # [M]
            shares[:, self.groups == group] = open_here[:, None]
        return shares

    def posterior_covariance(self, group: int, points: Array, others: Array) -> Array:
        """The covariance (N, N) of a group's processes at others (N, P), over their variance, after values at points (M, P).

        Rasmussen & Williams 2006, equation 2.24.
        """
        factor = _factor(self._covariance(group, points, points), self.noises[group])
        explained = solve_triangular(factor, self._covariance(group, points, others), lower=True)  # [M, N]
        return self._covariance(group, others, others) - explained.T @ explained

    def _covariance(self, group: int, points: Array, others: Array) -> Array:
        return _matern(_squares(points, others), self.lengths[group])[0]


def _squares(points: Array, others: Array) -> Array:
    """Squared differences (P, N, M) of points (N, P) and others (M, P)."""
    return ((points[:, None] - others[None]) ** 2).transpose(2, 0, 1)


def _matern(squares: Array, lengths: Array) -> tuple[Array, Array]:
    """Covariances (N, M), equation 4.17, and minus twice their derivative by the squared scaled distance."""
    scaled = ROOT * np.sqrt(np.tensordot(lengths**-2.0, squares, 1))  # [N, M]
    decay = np.exp(-scaled)
    return (1.0 + scaled + scaled**2 / 3.0) * decay, 5.0 / 3.0 * (1.0 + scaled) * decay


def _factor(covariance: Array, noise: float) -> Array:
    """The lower Cholesky factor of a covariance (M, M) with noise; changes the covariance."""
    covariance.flat[:: len(covariance) + 1] += noise
    return np.asarray(cholesky(covariance, lower=True))


def _most_likely(squares: Array, coefficients: Array, start: Array | None) -> Array:
    """Logarithms of the length scales and the noise, (P + 1,), that coefficients (M, K) share."""
    from scipy.optimize import minimize  # slow to load

    dimensions = len(squares)
    usual = np.full(dimensions, np.log(USUAL_LENGTH))
    first = np.append(usual, np.log(FIRST_NOISE)) if start is None else start
    bounds: Sequence[tuple[float, float]] = [tuple(np.log(LENGTHS))] * dimensions + [tuple(np.log(NOISES))]
    strength = np.sqrt((coefficients**2).mean(0))  # [K]
    coefficients, strength = coefficients[:, strength > 0.0], strength[strength > 0.0]
    counts = (strength / strength.max()) ** 2  # [K]
    scaled = coefficients / strength
    optimum = minimize(
        _unlikelihood,
        first,
        args=(squares, scaled, counts),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": MOST_STEPS},
    )
    return np.asarray(optimum.x)


def _unlikelihood(logarithms: Array, squares: Array, coefficients: Array, counts: Array) -> tuple[float, Array]:
    """Minus the logarithmic marginal likelihood, equations 5.8 and 5.9, and its derivatives (P + 1,).

    Coefficients (M, K) count by `counts` (K,), each with its most likely variance.
    """
    members = len(coefficients)
    lengths, noise = np.exp(logarithms[:-1]), np.exp(logarithms[-1])
    covariance, slope = _matern(squares, lengths)
    factor = _factor(covariance, noise)
    inverse = cho_solve((factor, True), np.eye(members))
    weights = inverse @ coefficients  # [M, K]
    variances = np.maximum(np.einsum("mk,mk->k", coefficients, weights) / members, 1e-300)  # [K]
    halves = 0.5 * members * np.log(variances) + np.log(np.diag(factor)).sum()
    outer = (weights * (counts / variances)) @ weights.T - counts.sum() * inverse  # [M, M]
    by_lengths = squares.reshape(len(squares), members**2) @ (outer * slope).ravel() * lengths**-2.0  # [P]
    away = (logarithms[:-1] - np.log(USUAL_LENGTH)) / np.log(USUAL_FACTOR) ** 2  # [P]
    value = counts @ halves + 0.5 * away @ away * np.log(USUAL_FACTOR) ** 2
    gradient = np.append(away - 0.5 * by_lengths, -0.5 * noise * np.trace(outer))
    return float(value), gradient
