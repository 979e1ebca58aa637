"""A committee of emulators of one field: draws of its posterior, and processes through the same runs with other covariances.

All of it is computed on a coarse lattice.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.words import one_line
from native.ray_casting import SampledField, SurfaceCaster, VolumeCaster
from surrogate.answers.opinions import Opinions, ProcessOpinions
from surrogate.emulation import FieldEmulator
from surrogate.emulation.components import Components, products_of, without
from surrogate.emulation.fitting import Members
from surrogate.emulation.processes import Processes
from surrogate.emulation.validation import folds_of
from surrogate.model.field_model import FieldPoint

SIDE = 32  # samples of a field along its longest side
COARSER = 4.0  # times: the distance of samples along rays


@dataclass(frozen=True, eq=False)
class Committee:
    """Other opinions than those of one emulator."""

    emulator: FieldEmulator  # on a coarse lattice

    __repr__ = one_line

    @classmethod
    def of(cls, emulator: FieldEmulator) -> Committee:
        """The committee beside an emulator."""
        return cls(thinned(emulator))

    @cached_property
    def _processes(self) -> ProcessOpinions:
        return ProcessOpinions(self.emulator.processes)

    def at(self, point: FieldPoint) -> Opinions:
        """The fields that its members expect there, first that of the emulator itself."""
        posterior, holes = self.emulator.posterior(point.simulation), self.emulator.holes(point.simulation)
        opinions = self._processes.coefficients(point.simulation, posterior.coefficients, posterior.spreads)
        fields = [replace(posterior, coefficients=c).values().reshape(self.emulator.shape) for c in opinions]
        casters = [
            caster_of(self.emulator, values, holes, point.appearance, point.sample_distance) for values in fields
        ]
        return Opinions(tuple(partial(caster.draw, threads=1) for caster in casters))

    def own(self, point: FieldPoint) -> VolumeCaster | SurfaceCaster:
        """The field that its emulator expects there, ready to be drawn."""
        emulator, at = self.emulator, point.simulation
        values = emulator.posterior(at).values().reshape(emulator.shape)
        return caster_of(emulator, values, emulator.holes(at), point.appearance, point.sample_distance)


def caster_of(
    emulator: FieldEmulator,
    values: NDArray[np.float32],
    holes: NDArray[np.bool_] | None,
    appearance: VolumeRendering | Isosurface,
    sample_distance: float | None,
) -> VolumeCaster | SurfaceCaster:
    """A field (Z, Y, X) on an emulator's coarse lattice, ready to be drawn in an appearance, with long steps along rays."""
    field = SampledField(values, holes, emulator.spacing, emulator.origin)
    if not isinstance(appearance, VolumeRendering):
        return SurfaceCaster.of(field, appearance)
    distance = None if sample_distance is None else sample_distance * COARSER
    return VolumeCaster.of(field, appearance, sample_distance=distance, threads=1)


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
