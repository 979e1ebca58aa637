"""The parameters whose pictures are nearest to given ones: a scan, then Levenberg-Marquardt from its best points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import one_line
from surrogate.answers.targets import Target, smallest
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.model import Surrogate
from surrogate.randomness import sobol_points

SCAN_SIDE, FIT_SIDE = 64, 128  # pixels along the longer side
FEW, MANY = 32, 512  # points scanned, for up to two parameters and for more
STARTS = 4
STEPS = 10
DIFFERENCE = 0.02  # central differences to either side, where a range is 2: smaller ones see single Gaussians vanish
DAMPING, LEAST_GAIN = 1e-3, 1e-3

Array = NDArray[np.float64]
Residuals = Callable[[Array], Array]  # of points (B, P) in [-1, 1], (B, N)


@dataclass(frozen=True, eq=False)
class Fit:
    """A point where pictures differ least from the targets nearby.

    Attributes
    ----------
    point : (P,) normalized parameters.
    cost : the mean square of residuals.
    curvature : (P, P), J'J / N of the residuals' derivatives by normalized parameters.
    """

    point: Array
    cost: float
    curvature: Array

    __repr__ = one_line


def residuals_of(surrogate: Surrogate, targets: Sequence[Target], background: Sequence[float] | None) -> Residuals:
    """Differences of the surrogate's pictures from the targets, over the pixels that count."""
    space, behind = surrogate.space, background or WHITE

    def residuals(points: Array) -> Array:
        rows, each = space.denormalize(points), []
        for target in targets:
            pictures = surrogate.render(rows, target.camera, outside="allow")
            differences = np.stack([composite(picture, behind) for picture in pictures]) - target.picture
            each.append((differences if target.mask is None else differences[:, target.mask]).reshape(len(points), -1))
        return np.concatenate(each, axis=1).astype(np.float64)

    return residuals


def best_fits(surrogate: Surrogate, targets: Sequence[Target], background: Sequence[float] | None) -> list[Fit]:
    """Local solutions, best first."""
    parameters = len(surrogate.space)
    coarse = residuals_of(surrogate, smallest(targets, SCAN_SIDE), background)
    fine = residuals_of(surrogate, smallest(targets, FIT_SIDE), background)
    starts = scanned(coarse, parameters)[: 1 if parameters <= 2 else STARTS]
    return sorted((fitted(fine, start) for start in starts), key=lambda fit: fit.cost)


def scanned(residuals: Residuals, parameters: int, batch: int = 32) -> Array:
    """Sobol points (N, P), those with the least residuals first."""
    count = FEW if parameters <= 2 else MANY
    points = sobol_points(count, parameters)
    costs = np.concatenate([(residuals(points[i : i + batch]) ** 2).mean(1) for i in range(0, count, batch)])
    return np.asarray(points[costs.argsort(kind="stable")])


def fitted(residuals: Residuals, start: Array) -> Fit:
    """The nearest minimum within [-1, 1], by Levenberg-Marquardt (Nocedal & Wright 2006, chapter 10.3)."""
    point, damping = start, DAMPING
    own = residuals(point[None])[0]
    jacobian = derivative(residuals, point)
    for _ in range(STEPS):
        curvature, slope = jacobian.T @ jacobian, jacobian.T @ own
        scale = np.diag(curvature) + 1e-6 * np.trace(curvature) + 1e-12
        dampings = (damping, 30.0 * damping, 1000.0 * damping)
        steps = [np.linalg.solve(curvature + d * np.diag(scale), slope) for d in dampings]
        tried = [np.clip(point - step, -1.0, 1.0) for step in steps]
        others = residuals(np.stack(tried))
        costs = (others**2).mean(1)
        best, before = int(costs.argmin()), float((own**2).mean())
        if costs[best] >= before * (1.0 - LEAST_GAIN):
            if costs[best] < before:
                point, own = tried[best], others[best]
                jacobian = derivative(residuals, point)
            break
        point, own = tried[best], others[best]
        damping *= (0.3, 3.0, 100.0)[best]
        jacobian = derivative(residuals, point)
    return Fit(point, float((own**2).mean()), jacobian.T @ jacobian / len(own))


def derivative(residuals: Residuals, point: Array) -> Array:
    """(N, P) by central differences in one batch, one-sided at the bounds."""
    steps = DIFFERENCE * np.eye(len(point))
    above, below = np.clip(point + steps, -1.0, 1.0), np.clip(point - steps, -1.0, 1.0)
    values = residuals(np.concatenate([above, below]))
    widths = (above - below).sum(1)  # [P]
    return np.asarray(((values[: len(point)] - values[len(point) :]) / widths[:, None]).T)
