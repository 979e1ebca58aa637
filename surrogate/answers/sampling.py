"""Samples of the parameters that draw pictures: normal near each solution, and moved where pictures at samples say otherwise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, truncnorm

from surrogate.answers.inverse import FIT_SIDE, Fit, Problem, corrected
from surrogate.answers.number_targets import NumberResiduals
from surrogate.answers.residuals import angle_between, mean_squares
from surrogate.emulation.validation import SHARE, conformal_rank
from surrogate.randomness import sobol_points

SAMPLES, SWEEPS = 400, 20
CHECKED_DRAFTS, CHECKED = 96, 48  # samples whose pictures check the normal approximation
AGREE = 0.3  # the share of these that count, below which the approximation is replaced
WALKERS, MOVES = 48, 8  # samples that move then, and how often
STRETCH = 2.0
MAPPED, JITTER = 2048, 0.02  # points over the box, and how far walkers begin from these
SAME_VIEW = math.radians(5.0)
RIDGE = 1e-12

Array = NDArray[np.float64]


def distinct(fits: Sequence[Fit], factor: float) -> list[Fit]:
    """Those that are about as likely as the best, and lie outside each other's 90 % sets, or are seen by other cameras."""
    most = chi2.ppf(SHARE, len(fits[0].point))
    solutions: list[Fit] = []
    for fit in fits:
        likely = (fit.cost - fits[0].cost) / factor < most
        if likely and all(_apart(fit, one, most * factor) for one in solutions):
            solutions.append(fit)
    return solutions


def _apart(fit: Fit, other: Fit, most: float) -> bool:
    pairs = list(zip(fit.cameras, other.cameras, strict=True))
    if any(angle_between(*pair) > SAME_VIEW for pair in pairs):
        return True
    difference = fit.point - other.point
    return bool(difference @ other.curvature @ difference > most)


def interval_ends(residuals: Problem, fits: Sequence[Fit], factor: float) -> tuple[Array, bool]:
    """(ends (P, 2) of intervals that hold 90 % of samples and the best of distinct solutions, and `samples_of`'s word)."""
    samples, sampled = samples_of(residuals, fits, factor)
    best = fits[0].point[: residuals.parameters]
    low, high = np.quantile(samples[:, : len(best)], [(1.0 - SHARE) / 2.0, (1.0 + SHARE) / 2.0], axis=0)
    return np.stack([np.minimum(low, best), np.maximum(high, best)], axis=1), sampled


def margins_of(ends: Array, truths: Array) -> Array:
    """Shares (P,) of their widths by which intervals (M, P, 2) must grow to either side to hold nine in ten truths (M, P).

    Romano et al. 2019, "Conformalized quantile regression", for each parameter; by shares, and never negative.
    """
    outside = np.maximum(ends[..., 0] - truths, truths - ends[..., 1]) / np.maximum(np.ptp(ends, axis=-1), RIDGE)
    return np.asarray(np.maximum(np.sort(outside, axis=0)[conformal_rank(len(ends)) - 1], 0.0))


def widened(ends: Array, margins: Array) -> Array:
    """Intervals (..., P, 2) grown by margins (P,), within the bounds."""
    more = margins * np.ptp(ends, axis=-1)
    return np.clip(np.stack([ends[..., 0] - more, ends[..., 1] + more], axis=-1), -1.0, 1.0)


def samples_of(residuals: Problem, fits: Sequence[Fit], factor: float) -> tuple[Array, bool]:
    """(samples (S, U), and False where the normal approximation holds): those of all solutions, about as many of each.

    Pictures at some of the normal samples check the approximation.  Where these say otherwise, samples move by the likelihood
    itself (Goodman & Weare 2010, "Ensemble samplers with affine invariance").  Few numbers of a field settle combinations of
    parameters at most: their likelihood is mapped over the box.
    """
    if isinstance(residuals, NumberResiduals):
        return _mapped(residuals, fits[0], factor), True
    samples = [normal_samples(fit, factor, seed) for seed, fit in enumerate(fits)]
    moved, wrong = [], False
    for seed, (fit, own) in enumerate(zip(fits, samples, strict=True)):
        costs, count = _costs_near(residuals, fit)
        some = own[: max(count // len(fits), 2 * len(fit.point) + 2)]
        away = some - fit.point
        expected = fit.cost + np.einsum("cp,pq,cq->c", away, fit.curvature, away)
        own_costs = costs(some)
        log = -(own_costs - expected) / (2.0 * factor)
        ratios = np.exp(log - log.max())
        wrong |= bool(ratios.sum() ** 2 / (ratios**2).sum() < AGREE * len(some))
        moved.append((costs, some, own_costs, seed))
    if not wrong:
        return np.concatenate(samples), False
    walkers = max(WALKERS // len(fits), 2 * len(fits[0].point) + 2)
    return np.concatenate([_stretched(c, s[:walkers], f[:walkers], factor, seed) for c, s, f, seed in moved]), True


def _mapped(residuals: NumberResiduals, fit: Fit, factor: float) -> Array:
    """(S, P), the likeliest of many points over the box, after moves."""
    costs, _ = _costs_near(residuals, fit)
    points = np.concatenate([fit.point[None], sobol_points(MAPPED, len(fit.point))])
    own_costs = costs(points)
    weights = np.exp(-(own_costs - own_costs.min()) / (2.0 * factor))
    chosen = np.random.default_rng(0).choice(len(points), 2 * WALKERS, p=weights / weights.sum())
    spread = np.clip(
        points[chosen] + JITTER * np.random.default_rng(1).standard_normal(points[chosen].shape), -1.0, 1.0
    )
    return _stretched(costs, spread, costs(spread), factor, 0)


def _costs_near(residuals: Problem, fit: Fit) -> tuple[Callable[[Array], Array], int]:
    """Costs of points (B, U) near a solution, equal to those that it was fitted by there, and how many are affordable."""
    own = residuals.seen_from(dict(enumerate(fit.cameras))).at_most(FIT_SIDE)
    if own.draft is None:
        return own.costs, CHECKED
    return partial(mean_squares, corrected(own, fit.point)), CHECKED_DRAFTS


def _stretched(costs: Callable[[Array], Array], samples: Array, own_costs: Array, factor: float, seed: int) -> Array:
    """(S, U), samples after moves, each along the line to another one."""
    random = np.random.default_rng(seed)
    points, own_costs, unknowns, visited = samples.copy(), own_costs.copy(), samples.shape[1], []
    halves = np.array_split(np.arange(len(points)), 2)
    for move in range(MOVES):
        for mine, others in (halves, halves[::-1]):
            z = (1.0 + (STRETCH - 1.0) * random.random(len(mine))) ** 2 / STRETCH
            partners = points[random.choice(others, len(mine))]
            tried = partners + z[:, None] * (points[mine] - partners)
            inside = np.flatnonzero((np.abs(tried) <= 1.0).all(1))
            if not len(inside):
                continue
            other = costs(tried[inside])
            log = (unknowns - 1) * np.log(z[inside]) - (other - own_costs[mine[inside]]) / (2.0 * factor)
            accepted = np.log(random.random(len(inside))) < log
            points[mine[inside[accepted]]], own_costs[mine[inside[accepted]]] = tried[inside[accepted]], other[accepted]
        if move >= MOVES // 2:
            visited.append(points.copy())
    return np.concatenate(visited)


def normal_samples(fit: Fit, factor: float, seed: int = 0) -> Array:
    """(S, U) of the normal distribution of a fit, cut to the bounds, by Gibbs sampling (Robert 1995)."""
    random, parameters = np.random.default_rng(seed), len(fit.point)
    precision = fit.curvature / factor + RIDGE * np.eye(parameters)
    samples = np.tile(fit.point, (SAMPLES, 1))
    for _ in range(SWEEPS):
        for j in range(parameters):
            others = np.delete(np.arange(parameters), j)
            pull = (samples[:, others] - fit.point[others]) @ precision[j, others] / precision[j, j]
            mean, deviation = fit.point[j] - pull, min(1.0 / math.sqrt(precision[j, j]), 100.0)
            bounds = (-1.0 - mean) / deviation, (1.0 - mean) / deviation
            values = truncnorm.rvs(*bounds, loc=mean, scale=deviation, size=SAMPLES, random_state=random)
            samples[:, j] = np.clip(values, -1.0, 1.0)
    return samples
