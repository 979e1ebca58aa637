"""Other embeddings for the same Gaussians: what a network that was trained anew might do between the runs, without training it.

The last hidden layer h(p) of the embedding network is known at the runs.  Gaussian processes through its principal components
say what else h could be between them, see `ProcessOpinions`.  Values that follow an emulated field get the opinions of its
processes at the same time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.answers.opinions import Opinions, ProcessOpinions
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.emulation.processes import Processes
from surrogate.model import Surrogate
from surrogate.model.representation import FIELD, GAUSSIANS

Array = NDArray[np.float64]

FEWEST = 4  # runs through which processes are laid
LEAST_SHARE = 1e-9  # of the variance, of components that count
MOST = 12_000  # Gaussians that are drawn: they differ about as all do
SEED = 0
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Embeddings:
    """A committee of embeddings.

    Attributes
    ----------
    surrogate : with some of its Gaussians, drawn by these alone.
    opinions : of the principal components of the hidden layers.
    mean, directions : (H,) and (K, H) of these components.
    """

    surrogate: Surrogate
    opinions: ProcessOpinions
    mean: Array  # [H]
    directions: Array  # [K, H]

    __repr__ = one_line

    @classmethod
    def of(cls, surrogate: Surrogate, points: ArrayLike) -> Embeddings | None:
        """The committee of a surrogate that learnt at normalized points (M, P); None for too few of them, or without Gaussians."""
        points = np.asarray(points, dtype=np.float64)
        if len(points) < FEWEST or not points.shape[1] or not len(surrogate.gaussians):
            return None
        hidden = np.array([_hidden(surrogate, point) for point in points])  # [M, H]
        mean = hidden.mean(0)
        left, sizes, directions = np.linalg.svd(hidden - mean, full_matrices=False)
        count = int((sizes**2 > LEAST_SHARE * max(float((sizes**2).sum()), TINY)).sum())
        if not count:
            return None
        processes = Processes.fit(points, (left * sizes)[:, :count])
        return cls(some_of(surrogate), ProcessOpinions(processes), mean, directions[:count])

    def at(self, parameters: Mapping[str, Any], function: TransferFunction | None = None) -> Opinions:
        """The Gaussians that its members expect, first those of the network itself; `Surrogate.at` says what it raises."""
        point = self.surrogate.place(parameters, "allow", function).simulation
        hidden = self.opinions.coefficients(point)[1:]
        values = [None] * len(hidden) if self._emulated is None else self._emulated.coefficients(point)[1:]
        surrogates = [self.surrogate, *map(self._other, hidden, values)]
        return Opinions(tuple(drawing_of(one, parameters, function) for one in surrogates))

    @cached_property
    def _emulated(self) -> ProcessOpinions | None:
        emulated = self.surrogate.deformation.emulated
        return None if emulated is None else ProcessOpinions(emulated.processes)

    def _other(self, components: Array, coefficients: Array | None) -> Surrogate:
        """The surrogate with other embeddings, which are those of one point only."""
        surrogate = self.surrogate
        hidden = torch.from_numpy(self.mean + components @ self.directions).to(surrogate.deformation.biases_in)  # [H]
        layers = iter(hidden.split([len(d.biases_in) for d in _deformations(surrogate)]))
        shifted = _shifted(surrogate.gaussians, surrogate.deformation, coefficients)
        return replace(
            surrogate,
            gaussians=shifted,
            deformation=surrogate.deformation.fixed(next(layers)),
            visualizations=tuple(
                one if one.simulation is None else replace(one, simulation=one.simulation.fixed(next(layers)))
                for one in surrogate.visualizations
            ),
        )


def _deformations(surrogate: Surrogate) -> list[BilinearDeformation]:
    """Those with the parameters of the simulation: that of the base, and those that were tuned with visualizations."""
    return [surrogate.deformation, *(v.simulation for v in surrogate.visualizations if v.simulation is not None)]


def _hidden(surrogate: Surrogate, point: Array) -> Array:
    """The last hidden layers (H,) of all its deformations at a point (P,)."""
    with torch.no_grad():
        layers = [one.hidden(torch.from_numpy(point).to(one.biases_in)) for one in _deformations(surrogate)]
    return torch.cat(layers).cpu().double().numpy()


def _shifted(gaussians: AnyGaussians, deformation: BilinearDeformation, coefficients: Array | None) -> AnyGaussians:
    """Gaussians that have followed `coefficients` (K,) of the emulated field."""
    if coefficients is None or deformation.emulated is None or not isinstance(gaussians, FieldGaussians):
        return gaussians
    shifts = deformation.emulated.shifts_of(torch.from_numpy(coefficients))  # [N]
    return replace(gaussians, values=gaussians.values + torch.stack([shifts, torch.zeros_like(shifts)], 1))


def drawing_of(
    surrogate: Surrogate, parameters: Mapping[str, Any], function: TransferFunction | None
) -> Callable[[Camera], NDArray[np.float32]]:
    """The drawing of `surrogate.at(parameters)`, or `under` a function, on one core."""
    at = surrogate.at if function is None else partial(surrogate.under, function)
    return partial(at(parameters, outside="allow").picture, background=None, threads=1)


def some_of(surrogate: Surrogate) -> Surrogate:
    """The surrogate with `MOST` of its Gaussians, drawn by these alone."""
    count = len(surrogate.gaussians)
    rows = torch.from_numpy(np.sort(np.random.default_rng(SEED).permutation(count)[:MOST]))  # [N]
    return replace(
        surrogate,
        gaussians=surrogate.gaussians.of(rows),
        deformation=surrogate.deformation.of(rows),
        visualizations=tuple(one.of(rows) for one in surrogate.visualizations),
        field=None,
        only=GAUSSIANS,
    )


def pair_at(surrogate: Surrogate, parameters: Mapping[str, Any], function: TransferFunction | None = None) -> Opinions:
    """The Gaussians and the emulated field, as drawings of one member; `surrogate` has both."""
    return Opinions(tuple(drawing_of(surrogate.using(name), parameters, function) for name in (GAUSSIANS, FIELD)))
