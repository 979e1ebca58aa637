"""Several opinions of one picture: where they differ, the runs do not settle what is seen.

Opinions of Gaussian processes are draws of their posterior, and what processes with other covariances expect.  All pictures are
small, so that asking takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.emulation.processes import Processes
from surrogate.evaluation.metrics import WHITE, composite, decibels

Array = NDArray[np.float64]

SMALLER = 4  # times: the sides of pictures
DRAWS = 2  # of the posterior
JITTER = 1e-8  # of the variance, for covariances of smooth processes
SEED = 0


def _exponential(squares: Array) -> Array:
    return np.exp(-np.sqrt(squares))


def _squared_exponential(squares: Array) -> Array:
    return np.exp(-0.5 * squares)


# Rougher and smoother than the processes' own; Rasmussen & Williams 2006, chapter 4.2.
COVARIANCES: tuple[Callable[[Array], Array], ...] = (_exponential, _squared_exponential)


@dataclass(frozen=True, eq=False)
class ProcessOpinions:
    """Expectations of K processes, and others that fit the runs as well."""

    processes: Processes

    __repr__ = one_line

    def open_share(self, point: Array) -> float:
        """The share of the ensemble's variance that the runs leave open at normalized parameters (P,), from 0 to 1."""
        variance = float(self.processes.variances.sum())
        _, deviations = self.processes.predict(point[None])
        return min(1.0, float((deviations**2).sum()) / variance) if variance > 0.0 else 0.0

    @cached_property
    def usual_shares(self) -> tuple[float, float]:
        """The largest `open_share` at a run itself, and the 95th percentile at runs that are left out."""
        own = max(map(self.open_share, self.processes.points), default=0.0)
        shares, variances = self.processes.left_out_shares(), self.processes.variances  # [M, K], [K]
        left_out = shares @ variances / max(float(variances.sum()), 1e-300)  # [M]
        return own, float(np.quantile(left_out, 0.95)) if len(left_out) else 0.0

    def coefficients(self, point: Array, means: Array | None = None, deviations: Array | None = None) -> list[Array]:
        """Those (K,) that each expects at a point (P,): first the processes themselves.

        Other `means` and `deviations` (K,) than the processes' own may be given.
        """
        if means is None or deviations is None:
            (means,), (deviations,) = self.processes.predict(point[None])
        normal = np.random.default_rng(SEED).standard_normal((DRAWS, len(means)))
        return [means, *(means + normal * deviations), *(self._other(kind, point) for kind in range(len(COVARIANCES)))]

    def _other(self, kind: int, point: Array) -> Array:
        """Coefficients (K,) by another covariance."""
        own = self.processes
        means = np.zeros(own.coefficients.shape[1])
        for group, lengths in enumerate(own.lengths):
            mine = own.groups == group
            near = COVARIANCES[kind](_squares(point[None], own.points, lengths))[0]  # [M]
            means[mine] = near @ self._weights[kind][:, mine]
        return means

    @cached_property
    def _weights(self) -> list[Array]:
        """Those (M, K) of the means, by covariance."""
        own = self.processes
        weights = [np.zeros_like(own.coefficients) for _ in COVARIANCES]
        for covariance, each in zip(COVARIANCES, weights, strict=True):
            for group, (lengths, noise) in enumerate(zip(own.lengths, own.noises, strict=True)):
                matrix = covariance(_squares(own.points, own.points, lengths))
                matrix[np.diag_indices_from(matrix)] += noise + JITTER
                mine = own.groups == group
                each[:, mine] = cho_solve((cholesky(matrix, lower=True), True), own.coefficients[:, mine])
        return weights


@dataclass(frozen=True, eq=False)
class Opinions:
    """Ways to draw one member, by camera as premultiplied RGBA (H, W, 4); the first is what the others are compared with."""

    drawings: tuple[Callable[[Camera], NDArray[np.float32]], ...]

    __repr__ = one_line

    def squares(self, camera: Camera, background: Sequence[float] | None) -> Array:
        """The squared differences (H, W, 3) of small pictures from the first, as displayed, mean over the others."""
        small = smaller(camera)
        own, *others = (composite(draw(small), background or WHITE).astype(np.float64) for draw in self.drawings)
        return np.mean([(other - own) ** 2 for other in others], axis=0)

    def agreement(self, camera: Camera, background: Sequence[float] | None) -> float:
        """The PSNR, dB, between them."""
        return decibels(float(self.squares(camera, background).mean()))


def smaller(camera: Camera) -> Camera:
    """The same view by which opinions are compared."""
    return camera.resized(max(camera.width // SMALLER, 1), max(camera.height // SMALLER, 1))


def _squares(first: Array, second: Array, lengths: Array) -> Array:
    """Squared distances (A, B) of points (A, P) and (B, P), in length scales."""
    return (((first[:, None] - second[None]) / lengths) ** 2).sum(-1)
