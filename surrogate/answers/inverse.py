"""The unknowns whose pictures are nearest to given ones: a scan, then Levenberg-Marquardt from its best points."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.answers.number_targets import NumberResiduals
from surrogate.answers.residuals import Residuals, angle_between
from surrogate.randomness import sobol_points

SCAN_SIDE, ROUGH_SIDE, FIT_SIDE = 32, 64, 128  # pixels along the longer side
FEW, MANY = 32, 512  # points scanned, for up to two parameters and for more
STARTS, FINISHED = 8, 2  # local solutions by drafts, and those that are refined by pictures
SEARCHED, APART = 6, math.radians(20.0)  # views from which cameras are fitted, with angles between them
ROUGH_STEPS = 5, 10  # of fits by drafts, after each of which half of the solutions go on
STEPS = 10
DIFFERENCE = 0.02  # central differences to either side, where a range is 2: smaller ones see single Gaussians vanish
DAMPING, LEAST_GAIN = 1e-3, 1e-3

Array = NDArray[np.float64]
Function = Callable[[Array], Array]  # of points (B, U) in [-1, 1], (B, N)
Problem = Residuals | NumberResiduals
Start = tuple[Problem, Array]  # where a fit begins, (U,)


@dataclass(frozen=True, eq=False)
class Fit:
    """A point where pictures differ least from the targets nearby.

    Attributes
    ----------
    point : (U,) unknowns, normalized parameters first.
    cost : the mean square of residuals.
    curvature : (U, U), J'J / N of the residuals' derivatives by the unknowns.
    cameras : those that the unknowns move, or known ones.
    """

    point: Array
    cost: float
    curvature: Array
    cameras: tuple[Camera, ...] = ()

    __repr__ = one_line


def best_fits(residuals: Problem) -> list[Fit]:
    """Local solutions, best first.

    Points are scanned, and the best fitted to, by drafts, where pictures are drawn from an emulated field at all.  Cameras that
    are not known are searched among the views, and fitted like parameters.
    """
    starts: list[Start]
    if isinstance(residuals, NumberResiduals) or residuals.unknowns == residuals.parameters:
        starts = [(residuals, point) for point in scanned(residuals)[:STARTS]]
    else:
        starts = searched(residuals)
        if residuals.draft is not None:  # by the cameras that these find, other parameters may be nearer
            starts = [start for own, point in roughly(starts)[:FINISHED] for start in again(own, point)]
    if residuals.draft is not None:
        starts = roughly(starts)[:FINISHED]
    elif residuals.unknowns <= 2:
        starts = starts[:FINISHED]
    fits = []
    for own, point in starts:
        fine = own.at_most(FIT_SIDE)
        fit = fitted(fine, point, fine.draft)
        fits.append(replace(fit, cameras=own.cameras))
    return sorted(fits, key=lambda fit: fit.cost)


def roughly(starts: Sequence[Start]) -> list[Start]:
    """Solutions by drafts that are corrected by their error nearby, best first; of half the starts."""
    for steps in ROUGH_STEPS:
        better = []
        for own, point in starts:
            small = own.at_most(ROUGH_SIDE)
            nearby = corrected(small, point)
            place = fitted(nearby, point, nearby, steps).point
            better.append((float(small.costs(place[None])[0]), own, place))
        better.sort(key=lambda one: one[0])
        starts = [(own, point) for _, own, point in better[: max(len(better) // 2, FINISHED)]]
    return list(starts)


def corrected(residuals: Problem, point: Array) -> Function:
    """Drafts, less their error at a `point` (U,)."""
    draft = residuals.draft
    assert draft is not None
    offset = residuals(point[None]) - draft(point[None])  # [1, N]
    return lambda points: draft(points) + offset


def scanned(residuals: Problem) -> Array:
    """Sobol points (N, U), those with the least residuals first; cameras stay."""
    quick = (residuals.draft or residuals).at_most(SCAN_SIDE)
    parameters = residuals.parameters
    points = sobol_points(FEW if parameters <= 2 else MANY, parameters)
    points = np.pad(points, ((0, 0), (0, residuals.unknowns - parameters)))
    return np.asarray(points[quick.costs(points).argsort(kind="stable")])


def again(residuals: Problem, point: Array) -> list[Start]:
    """A solution, and the best of a scan by its cameras."""
    own = residuals.seen_from(dict(enumerate(residuals.seen_by(point))))
    here = np.append(point[: own.parameters], np.zeros(own.unknowns - own.parameters))
    return [(own, start) for start in (here, *scanned(own)[:STARTS])]


def searched(residuals: Residuals) -> list[Start]:
    """Views and points whose pictures are nearest, best first, views being apart."""
    points = sobol_points(FEW if residuals.parameters <= 2 else 2 * FEW, residuals.parameters)
    costs = residuals.costs_by_view(points, SCAN_SIDE)  # [B, V, T]
    first, *others = map(int, np.flatnonzero(np.isfinite(costs[0, 0])))
    rest = costs[:, :, others].min(1).sum(-1)  # [B]
    total = costs[:, :, first] + rest[:, None]  # [B, V]
    chosen: list[tuple[int, Start]] = []
    for flat in total.ravel().argsort(kind="stable"):
        number, view = divmod(int(flat), total.shape[1])
        if any(angle_between(residuals.views[view], residuals.views[one]) < APART for one, _ in chosen):
            continue
        views = {first: view, **{i: int(costs[number, :, i].argmin()) for i in others}}
        own = residuals.seen_from({i: residuals.views[v] for i, v in views.items()})
        chosen.append((view, (own, scanned(own)[0])))
        if len(chosen) == SEARCHED:
            break
    return [start for _, start in chosen]


def fitted(residuals: Function, start: Array, slopes: Function | None = None, steps: int = STEPS) -> Fit:
    """The nearest minimum within [-1, 1], by Levenberg-Marquardt (Nocedal & Wright 2006, chapter 10.3).

    Derivatives are those of `slopes`, where a smooth and cheaper function has about the same, until these lead no further; they
    are one-sided.
    """
    point, damping, cheap = start, DAMPING, slopes is not None
    own = residuals(point[None])[0]
    jacobian = derivative(residuals, point) if slopes is None else derivative(slopes, point, smooth=True)
    for _ in range(steps):
        before = float((own**2).mean())
        lower = _lower(residuals, point, own, jacobian, damping)
        if lower is not None:
            point, own, factor = lower
            damping *= factor
        gained = lower is not None and float((own**2).mean()) < before * (1.0 - LEAST_GAIN)
        if not gained and (not cheap or slopes is residuals):
            break
        cheap = cheap and gained
        jacobian = derivative(slopes, point, smooth=True) if cheap and slopes else derivative(residuals, point)
    return Fit(point, float((own**2).mean()), jacobian.T @ jacobian / len(own))


def _lower(
    residuals: Function, point: Array, own: Array, jacobian: Array, damping: float
) -> tuple[Array, Array, float] | None:
    """The first of three ever shorter steps that lowers the cost: the point, its residuals, and a factor on the damping."""
    curvature, slope = jacobian.T @ jacobian, jacobian.T @ own
    scale = np.diag(curvature) + 1e-6 * np.trace(curvature) + 1e-12
    for more, factor in ((1.0, 0.3), (30.0, 3.0), (1000.0, 100.0)):
        step = np.linalg.solve(curvature + more * damping * np.diag(scale), slope)
        place = np.clip(point - step, -1.0, 1.0)
        other = residuals(place[None])[0]
        if (other**2).mean() < (own**2).mean():
            return place, other, factor
    return None


def derivative(residuals: Function, point: Array, *, smooth: bool = False) -> Array:
    """(N, U) by central differences in one batch, one-sided at the bounds; to one side alone of a `smooth` function."""
    steps = DIFFERENCE * np.eye(len(point))
    above, below = np.clip(point + steps, -1.0, 1.0), np.clip(point - steps, -1.0, 1.0)
    if smooth:
        aside = np.where((point > 0.0)[:, None], below, above)
        values = residuals(np.concatenate([point[None], aside]))
        return np.asarray(((values[1:] - values[0]) / (aside - point).sum(1)[:, None]).T)
    values = residuals(np.concatenate([above, below]))
    widths = (above - below).sum(1)  # [U]
    return np.asarray(((values[: len(point)] - values[len(point) :]) / widths[:, None]).T)
