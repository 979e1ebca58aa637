"""Interpolation rules: the weights of known images in a trivial predictor's sum.

All are linear in the images, so a rule is a matrix of weights from known points to wanted ones.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import chain, combinations_with_replacement, product

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import QhullError
from scipy.spatial.distance import cdist

Weights = NDArray[np.float64]  # [T, M]
NEIGHBOURS = 4
RIDGES = (1e-6, 1e-4, 1e-2, 1e-1, 1.0)
ON_HULL = 1e-11  # of the way to the middle: moves targets inside that rounding puts outside the hull
LENGTHS = (0.5, 1.0, 2.0, 4.0)

# From known parameters (M, P) and wanted ones (T, P), both normalized, to weights (T, M).
Rule = Callable[[NDArray[np.float64], NDArray[np.float64]], Weights]


def mean_image(points: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
    """Equal weights."""
    return np.full((len(wanted), len(points)), 1.0 / len(points))


def nearest_member(points: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
    """The member at the smallest distance in normalized parameters."""
    return np.eye(len(points))[cdist(wanted, points).argmin(axis=1)]


def linear(points: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
    """Piecewise-linear interpolation: between neighbours in one dimension, barycentric on a Delaunay triangulation in more.

    Targets outside the convex hull take the nearest member.
    """
    members = np.eye(len(points))
    if points.shape[1] == 1:
        order = np.argsort(points[:, 0])
        return np.stack([np.interp(wanted[:, 0], points[order, 0], row[order]) for row in members], axis=1)
    nearest = nearest_member(points, wanted)
    try:
        interpolator = LinearNDInterpolator(points, members)
    except QhullError:  # fewer members than a simplex has corners, or all in a plane
        return nearest
    weights = nearest
    for targets in (wanted + ON_HULL * (points.mean(axis=0) - wanted), wanted):
        inside = interpolator(targets)  # [T, M], nan outside
        weights = np.where(np.isnan(inside), weights, inside)
    return weights


def inverse_distance(points: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
    """Inverse-distance weights of the `NEIGHBOURS` nearest points; at a known point, that point alone."""
    distances = cdist(wanted, points)  # [T, M]
    order = np.argsort(distances, axis=1, kind="stable")[:, :NEIGHBOURS]  # [T, min(M, NEIGHBOURS)]
    weights = np.zeros_like(distances)
    for row, near, away in zip(weights, order, distances, strict=True):
        row[near] = 1.0 / away[near] if away[near[0]] > 0.0 else np.eye(len(near))[0]
    return np.asarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float64)


def ridge(points: NDArray[np.float64], wanted: NDArray[np.float64], *, degree: int, penalty: float) -> Weights:
    """Ridge regression on all monomials up to `degree`."""
    features, targets = _monomials(points, degree), _monomials(wanted, degree)  # [M, F], [T, F]
    gram = features @ features.T + penalty * len(points) * np.eye(len(points))  # [M, M]
    return np.asarray(np.linalg.solve(gram, features @ targets.T).T, dtype=np.float64)


def radial(points: NDArray[np.float64], wanted: NDArray[np.float64], *, length: float, penalty: float) -> Weights:
    """Gaussian-process mean with a squared-exponential kernel around the mean image (Rasmussen & Williams 2006, 2.2)."""

    def kernel(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.exp(-0.5 * cdist(a, b, "sqeuclidean") / length**2)

    smooth = np.linalg.solve(kernel(points, points) + penalty * np.eye(len(points)), kernel(points, wanted)).T  # [T, M]
    return smooth + (1.0 - smooth.sum(axis=1, keepdims=True)) / len(points)


def fixed_rules(parameters: int) -> dict[str, Rule]:
    """Rules without constants, by name; piecewise-linear interpolation only up to three parameters.

    With more, most members lie outside the hull of the others, and a triangulation takes seconds for each view.
    """
    rules: dict[str, Rule] = {"mean image": mean_image, "nearest member": nearest_member}
    rules[f"inverse distances to the {NEIGHBOURS} nearest members"] = inverse_distance
    return {**rules, "linear interpolation": linear} if parameters <= 3 else rules


def setting_rules(parameters: int, plural: str) -> dict[str, Rule]:
    """Rules for a variation with `parameters` visualization parameters; `plural` names its settings."""
    if parameters == 1:
        return {"nearest trained setting": nearest_member, f"linear interpolation of {plural}": linear}
    between = f"inverse distances to the {NEIGHBOURS} nearest settings"
    return {"nearest trained setting": nearest_member, between: inverse_distance}


def crossed(first: Rule, second: Rule, parameters: int) -> Rule:
    """The rule whose weights are those of `first` for the leading `parameters` times those of `second` for the others.

    Known points must form a grid: each place in the leading parameters with the same places in the others, one after
    the other.
    """

    def weights(points: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
        repeated = int((points[:, :parameters] == points[0, :parameters]).all(axis=1).sum())
        places, settings = points[::repeated, :parameters], points[:repeated, parameters:]  # [A, P], [B, V]
        pairs = first(places, wanted[:, :parameters]), second(settings, wanted[:, parameters:])  # [T, A], [T, B]
        return np.einsum("ta,tb->tab", *pairs).reshape(len(wanted), -1)

    return weights


def joint_rules(parameters: int, settings: int) -> dict[str, Rule]:
    """Rules that predict an unseen member under an unseen setting from training members under trained settings."""
    between = linear if parameters <= 3 else inverse_distance
    among = linear if settings == 1 else inverse_distance
    return {
        "training members alone, the nearest one and setting": crossed(nearest_member, nearest_member, parameters),
        "training members alone, interpolated": crossed(between, among, parameters),
    }


def tuned_rules() -> list[dict[str, Rule]]:
    """Families of rules with constants to tune; of each family the best on validation members is taken."""
    return [
        {
            f"ridge regression (degree {d}, penalty {p:g})": partial(ridge, degree=d, penalty=p)
            for d, p in product((1, 2, 3), RIDGES)
        },
        {
            f"radial basis functions (length {s:g}, penalty {p:g})": partial(radial, length=s, penalty=p)
            for s, p in product(LENGTHS, RIDGES)
        },
    ]


def _monomials(points: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    """All monomials (N, F) up to `degree` of points (N, P)."""
    factors = chain.from_iterable(combinations_with_replacement(points.T, d) for d in range(degree + 1))
    return np.stack([np.prod([np.ones(len(points)), *columns], axis=0) for columns in factors], axis=1)
