"""F_vis: how Gaussians that the simulation's parameters have deformed follow the visualization parameters as well."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from catalogs.appearance import TransferFunction
from catalogs.variations import Variation, variation_from_json
from catalogs.words import one_line
from surrogate.deformation import Deformation, compose, load_deformation
from surrogate.deformation.values import ValuesDeformation
from surrogate.gaussians import Gaussians
from surrogate.storage.names import joined, part_of


@dataclass(frozen=True, eq=False)
class Visualization:
    """One variation of a surrogate's base appearance.

    Attributes
    ----------
    variation : the visualization parameters and the settings that were learnt from.
    deformation : F_vis, of (P_sim, P_vis), on the result of F_sim.
    simulation : F_sim as it was tuned together with F_vis; None where it is the base's, bit for bit.
    color_degree : of the Gaussians that it shows, at least that of the base.
    """

    variation: Variation
    deformation: Deformation
    simulation: Deformation | None = None
    color_degree: int = 0

    __repr__ = one_line

    def gaussians_at(self, gaussians: Gaussians, simulation: Deformation, parameters: Tensor) -> Gaussians:
        """The Gaussians at normalized simulation and visualization parameters (P + V,), NaN ones for the base.

        `gaussians` are the canonical ones and `simulation` the base's F_sim.
        """
        count = len(self.variation.space)
        alone = parameters[:-count]  # [P]
        if any(map(math.isnan, parameters[-count:].tolist())):
            return simulation.deformed(gaussians, alone)
        acted_on = self.simulation or simulation
        return self._wide(compose(gaussians, (acted_on, alone), (self.deformation, parameters)))

    def simulated(self, gaussians: Gaussians, simulation: Deformation, parameters: Tensor) -> Gaussians:
        """What F_vis acts on: the Gaussians at normalized simulation parameters (P,)."""
        return self._wide((self.simulation or simulation).deformed(gaussians, parameters))

    def under(
        self, gaussians: Gaussians, simulation: Deformation, parameters: Tensor, function: TransferFunction
    ) -> Gaussians:
        """The Gaussians at normalized simulation parameters (P,) under any transfer function.

        Raises ValueError where F_vis does not know what values its Gaussians stand for.
        """
        if not isinstance(self.deformation, ValuesDeformation):
            raise ValueError(
                f"this surrogate's F_vis is of kind {self.deformation.kind!r}, which knows only the displacements it learnt "
                f'{self.variation.space.names}: train with visualization_deformation = "values" for any transfer function'
            )
        return self.deformation.under(self.simulated(gaussians, simulation, parameters), function)

    def _wide(self, gaussians: Gaussians) -> Gaussians:
        """The same with colours of the degree that is shown, or of their own where that is higher."""
        degree = max(self.color_degree, gaussians.color_degree)
        return gaussians if degree == gaussians.color_degree else gaussians.with_color_degree(degree)

    def of(self, rows: Tensor) -> Visualization:
        """The same for some of the Gaussians, by index (M,)."""
        return self._changed(lambda deformation: deformation.of(rows))

    def to(self, device: torch.device) -> Visualization:
        """The same on another device."""
        return self._changed(lambda deformation: deformation.to(device))

    def copy(self) -> Visualization:
        """The same numbers in tensors of their own."""
        return self._changed(lambda deformation: deformation.copy())

    def _changed(self, change: Callable[[Deformation], Deformation]) -> Visualization:
        tuned = None if self.simulation is None else change(self.simulation)
        return replace(self, deformation=change(self.deformation), simulation=tuned)

    def record(self) -> dict[str, Any]:
        """JSON values that `load` needs beside the tensors."""
        return {
            "variation": self.variation.to_json(),
            "color_degree": self.color_degree,
            "deformation": self.deformation.record(),
            "simulation": self.simulation and self.simulation.record(),
        }

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> Visualization:
        """The visualization that had these `stored()` tensors and this `record()`."""
        parts = {
            name: load_deformation(part_of(tensors, name), record[name])
            for name in ("deformation", "simulation")
            if record[name] is not None
        }
        return cls(variation_from_json(record["variation"]), color_degree=int(record["color_degree"]), **parts)

    def stored(self) -> dict[str, Tensor]:
        """All tensors, those of F_vis and of the tuned F_sim."""
        parts = {"deformation": self.deformation, "simulation": self.simulation}
        return joined({name: part.stored() for name, part in parts.items() if part is not None})
