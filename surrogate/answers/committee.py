"""A committee of emulators of one field: draws of its posterior, and processes through the same runs with other covariances.

Where its members' pictures differ, the runs do not settle what is seen.  All of it is computed on a coarse lattice and in small
pictures, so that it takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_solve, cholesky

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.emulation import FieldEmulator
from surrogate.emulation.components import Components, products_of, without
from surrogate.emulation.fitting import Members
from surrogate.emulation.posterior import Posterior
from surrogate.emulation.processes import Processes
from surrogate.emulation.validation import folds_of
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.model.field_model import FieldPoint
from surrogate.ray_casting import SampledField, SurfaceCaster, VolumeCaster

Array = NDArray[np.float64]

SIDE = 32  # samples of a field along its longest side
SMALLER = 4  # times: the sides of pictures
COARSER = 4.0  # times: the distance of samples along rays
DRAWS = 4  # of the posterior
JITTER = 1e-8  # of the variance, for covariances of smooth processes
SEED = 0


def _exponential(squares: Array) -> Array:
    return np.exp(-np.sqrt(squares))


def _squared_exponential(squares: Array) -> Array:
    return np.exp(-0.5 * squares)


# Rougher and smoother than the emulator's own; Rasmussen & Williams 2006, chapter 4.2.
COVARIANCES: tuple[Callable[[Array], Array], ...] = (_exponential, _squared_exponential)


@dataclass(frozen=True, eq=False)
class Committee:
    """Other opinions than those of one emulator."""

    emulator: FieldEmulator  # on a coarse lattice

    __repr__ = one_line

    @classmethod
    def of(cls, emulator: FieldEmulator) -> Committee:
        """The committee beside an emulator."""
        return cls(thinned(emulator))

    def open_share(self, point: ArrayLike) -> float:
        """The share of the ensemble's variance that the runs leave open at normalized parameters (P,), from 0 to 1."""
        posterior, emulator = self.emulator.posterior(point), self.emulator
        variance = float(emulator.processes.variances.sum()) * emulator.factor**2
        return min(1.0, float((posterior.spreads**2).sum()) / variance) if variance > 0.0 else 0.0

    def at(self, point: FieldPoint) -> Opinions:
        """The fields that its members expect there."""
        posterior, emulator = self.emulator.posterior(point.simulation), self.emulator
        normal = np.random.default_rng(SEED).standard_normal((DRAWS, len(posterior.spreads)))
        coefficients = [
            posterior.coefficients,
            *(posterior.coefficients + normal * posterior.spreads),
            *(self._other(kind, point.simulation) for kind, _ in enumerate(COVARIANCES)),
        ]
        holes = emulator.holes(point.simulation)
        return Opinions(tuple(self._caster(replace(posterior, coefficients=c), holes, point) for c in coefficients))

    def own(self, point: FieldPoint) -> VolumeCaster | SurfaceCaster:
        """The field that its emulator expects there, ready to be drawn."""
        return self._caster(self.emulator.posterior(point.simulation), self.emulator.holes(point.simulation), point)

    def _caster(
        self, posterior: Posterior, holes: NDArray[np.bool_] | None, point: FieldPoint
    ) -> VolumeCaster | SurfaceCaster:
        emulator = self.emulator
        values = posterior.values().reshape(emulator.shape)
        field = SampledField(values, holes, emulator.spacing, emulator.origin)
        if not isinstance(point.appearance, VolumeRendering):
            return SurfaceCaster.of(field, point.appearance)
        distance = None if point.sample_distance is None else point.sample_distance * COARSER
        return VolumeCaster.of(field, point.appearance, sample_distance=distance)

    @cached_property
    def _weights(self) -> list[Array]:
        """Those (M, K) of the processes' means, by covariance."""
        own = self.emulator.processes
        weights = [np.zeros_like(own.coefficients) for _ in COVARIANCES]
        for covariance, each in zip(COVARIANCES, weights, strict=True):
            for group, (lengths, noise) in enumerate(zip(own.lengths, own.noises, strict=True)):
                matrix = covariance(_squares(own.points, own.points, lengths))
                matrix[np.diag_indices_from(matrix)] += noise + JITTER
                mine = own.groups == group
                each[:, mine] = cho_solve((cholesky(matrix, lower=True), True), own.coefficients[:, mine])
        return weights

    def _other(self, kind: int, point: Array) -> Array:
        """Coefficients (K,) by another covariance."""
        own = self.emulator.processes
        means = np.zeros(own.coefficients.shape[1])
        for group, lengths in enumerate(own.lengths):
            mine = own.groups == group
            near = COVARIANCES[kind](_squares(point[None], own.points, lengths))[0]  # [M]
            means[mine] = near @ self._weights[kind][:, mine]
        return means


@dataclass(frozen=True, eq=False)
class Opinions:
    """The fields of a committee at one point, ready to be drawn: first that of the emulator itself."""

    casters: tuple[VolumeCaster | SurfaceCaster, ...]

    __repr__ = one_line

    def pictures(self, camera: Camera, background: Sequence[float] | None) -> NDArray[np.float32]:
        """Small ones (N, H, W, 3), as displayed."""
        small = camera.resized(max(camera.width // SMALLER, 1), max(camera.height // SMALLER, 1))
        return np.stack([composite(caster.draw(small, threads=1), background or WHITE) for caster in self.casters])

    def squares(self, camera: Camera, background: Sequence[float] | None) -> NDArray[np.float64]:
        """The squared differences (H, W, 3) from the emulator's own small picture, mean over the others."""
        own, *others = self.pictures(camera, background).astype(np.float64)
        return np.mean([(other - own) ** 2 for other in others], axis=0)


def thinned(emulator: FieldEmulator) -> FieldEmulator:
    """The emulator on at most `SIDE` samples a side, spread over the same box: some of its own."""
    sides = [np.unique(np.linspace(0, n - 1, min(n, SIDE)).round().astype(int)) for n in emulator.shape]
    numbers = np.arange(len(emulator.mean)).reshape(emulator.shape)[np.ix_(*sides)]  # [z, y, x]
    steps = [(n - 1) / max(len(side) - 1, 1) for n, side in zip(emulator.shape, sides, strict=True)]
    x, y, z = (spacing * step for spacing, step in zip(emulator.spacing, steps[::-1], strict=True))
    some = numbers.ravel()
    return replace(
        emulator,
        mean=emulator.mean[some],
        modes=np.ascontiguousarray(emulator.modes[:, some]),
        residual=emulator.residual[some],
        shape=(len(sides[0]), len(sides[1]), len(sides[2])),
        spacing=(x, y, z),
        solid=None if emulator.solid is None else emulator.solid[some],
        outline=None if emulator.outline is None else thinned(emulator.outline),
        encodings={},
    )


def left_out(
    emulator: FieldEmulator, points: ArrayLike, fields: ArrayLike
) -> Iterator[tuple[FieldEmulator, NDArray[np.int64]]]:
    """Emulators that each learnt without a tenth of the members of `emulator`, and the numbers of those.

    The members' fields are (M, Z, Y, X), NaN in holes, at normalized parameters (M, P).  Length scales are fitted anew; the number
    of components, the scale of values, the factor on standard deviations and the outline of moving holes are the emulator's.
    """
    members = Members.of(points, fields)
    mean, differences = members.about_mean(emulator.scale)  # [V], [M, V]
    products = products_of(differences)
    folds = folds_of(len(differences))
    for fold in range(folds.max() + 1):
        learnt = np.flatnonzero(folds != fold)
        own = Components.of(without(products, learnt))
        coefficients = own.coefficients[:, : len(emulator.modes)]
        combinations = own.combinations[:, : len(emulator.modes)]
        combinations = (combinations - combinations.mean(0)).astype(np.float32)
        yield (
            replace(
                emulator,
                processes=Processes.fit(members.points[learnt], coefficients, emulator.processes),
                mean=mean + differences[learnt].mean(0),
                modes=combinations.T @ differences[learnt],
                encodings={},
            ),
            np.flatnonzero(folds == fold),
        )


def _squares(first: Array, second: Array, lengths: Array) -> Array:
    """Squared distances (A, B) of points (A, P) and (B, P), in length scales."""
    return (((first[:, None] - second[None]) / lengths) ** 2).sum(-1)
