"""Trivial predictors: a weighted sum of the training members' own pictures at the same view.

They may use every view of the training members, also those that the surrogate never saw.  Each is linear in the
pictures, so a predictor is no more than a matrix of weights from members to targets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError
from scipy.spatial.distance import cdist

Weights = NDArray[np.float64]  # [T, M]
RIDGES = (1e-6, 1e-4, 1e-2, 1e-1, 1.0)
LENGTHS = (0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True)
class Predictor:
    """A named rule from known parameters (M, P) and wanted ones (T, P), both normalized, to weights (T, M)."""

    name: str
    weights: Callable[[NDArray[np.float64], NDArray[np.float64]], Weights]


def mean_image(known: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
    """Every member alike."""
    return np.full((len(wanted), len(known)), 1.0 / len(known))


def nearest_member(known: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
    """The member at the smallest distance in normalized parameters."""
    return np.eye(len(known))[cdist(wanted, known).argmin(axis=1)]


def linear(known: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
    """Piecewise-linear interpolation: between neighbours in one dimension, barycentric on a Delaunay triangulation in more.

    Targets outside the convex hull take the nearest member.
    """
    if known.shape[1] == 1:
        return np.stack([np.interp(wanted[:, 0], *_sorted(known[:, 0], row)) for row in np.eye(len(known))], axis=1)
    weights = nearest_member(known, wanted)
    try:
        mesh = Delaunay(known)
    except QhullError:  # fewer members than a simplex has corners, or all in a plane
        return weights
    simplices = mesh.find_simplex(wanted, tol=1e-9)  # [T]
    for target in np.flatnonzero(simplices >= 0):
        transform = mesh.transform[simplices[target]]  # [P + 1, P]
        inner = transform[:-1] @ (wanted[target] - transform[-1])  # [P]
        weights[target] = 0.0
        weights[target, mesh.simplices[simplices[target]]] = [*inner, 1.0 - inner.sum()]
    return weights


def ridge(known: NDArray[np.float64], wanted: NDArray[np.float64], *, degree: int, penalty: float) -> Weights:
    """Ridge regression on all monomials up to `degree`."""
    features, targets = _monomials(known, degree), _monomials(wanted, degree)  # [M, F], [T, F]
    gram = features @ features.T + penalty * len(known) * np.eye(len(known))  # [M, M]
    return np.asarray(np.linalg.solve(gram, features @ targets.T).T, dtype=np.float64)


def radial(known: NDArray[np.float64], wanted: NDArray[np.float64], *, length: float, penalty: float) -> Weights:
    """Gaussian-process mean with a squared-exponential kernel around the mean image (Rasmussen & Williams 2006, 2.2)."""

    def kernel(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.exp(-0.5 * cdist(a, b, "sqeuclidean") / length**2)

    smooth = np.linalg.solve(kernel(known, known) + penalty * np.eye(len(known)), kernel(known, wanted)).T  # [T, M]
    return smooth + (1.0 - smooth.sum(axis=1, keepdims=True)) / len(known)


def fixed_predictors(parameters: int) -> list[Predictor]:
    """Those without anything to tune; piecewise-linear interpolation only up to three parameters."""
    found = [Predictor("mean image", mean_image), Predictor("nearest member", nearest_member)]
    return [*found, Predictor("linear interpolation", linear)] if parameters <= 3 else found


def tuned_predictors() -> Mapping[str, list[Predictor]]:
    """Families of which the best on validation members is taken."""
    return {
        "ridge regression": [
            Predictor(f"ridge regression (degree {d}, penalty {p:g})", _partial(ridge, degree=d, penalty=p))
            for d in (1, 2, 3)
            for p in RIDGES
        ],
        "radial basis functions": [
            Predictor(f"radial basis functions (length {s:g}, penalty {p:g})", _partial(radial, length=s, penalty=p))
            for s in LENGTHS
            for p in RIDGES
        ],
    }


def _partial(rule: Callable[..., Weights], **constants: float) -> Callable[..., Weights]:
    return lambda known, wanted: rule(known, wanted, **constants)


def _sorted(at: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    order = np.argsort(at)
    return at[order], values[order]


def _monomials(points: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    """All monomials (N, F) up to `degree` of points (N, P)."""
    columns = [np.ones(len(points))]
    level = [(np.ones(len(points)), 0)]
    for _ in range(degree):
        level = [(values * points[:, i], i) for values, first in level for i in range(first, points.shape[1])]
        columns += [values for values, _ in level]
    return np.stack(columns, axis=1)
