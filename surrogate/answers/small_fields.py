"""The emulated field on a coarse lattice, and small pictures of it, in a millisecond or two each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import field_of
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.answers.committee import Committee
from surrogate.model.field_model import FieldModel, FieldPoint


@dataclass(frozen=True, eq=False)
class SmallFields:
    """A field model on at most `committee.SIDE` samples a side."""

    model: FieldModel
    _committees: dict[str, Committee] = field(default_factory=dict)

    __repr__ = one_line

    def values(self, parameters: Mapping[str, Any]) -> NDArray[np.float32]:
        """The field's values (V,), without those in holes; parameters as `Surrogate.at` takes them."""
        point = self.model.point(parameters, "allow")
        emulator = self.committee(point).emulator
        values, holes = emulator.posterior(point.simulation).values(), emulator.holes(point.simulation)
        return values if holes is None else values[~holes.ravel()]

    def render(self, rows: Sequence[Mapping[str, Any]], camera: Camera) -> NDArray[np.float32]:
        """A picture (H, W, 4) of each row of parameters, as `Surrogate.render` gives it, with fewer samples along rays."""
        points = [self.model.point(row, "allow") for row in rows]
        return np.stack([self.committee(point).own(point).draw(camera, threads=1) for point in points])

    def committee(self, point: FieldPoint) -> Committee:
        """The one of the field that a point shows."""
        name = field_of(point.appearance)
        if name not in self._committees:
            self._committees[name] = Committee.of(self.model.emulators[name])
        return self._committees[name]
