"""Visualization deformations: Gaussians also follow the parameters of a variation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.variations import Variation, variation_from_json
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.deformation import BilinearDeformation, Deformation, compose, load_deformation
from surrogate.deformation.values import ValuesDeformation, displaced_by
from surrogate.gaussians import Gaussians
from surrogate.lighting import Lighting
from surrogate.storage.names import joined, part_of


@dataclass(frozen=True, eq=False)
class Visualization:
    """One variation of a surrogate's base appearance.

    Attributes
    ----------
    variation : the visualization parameters and the settings that were learnt from.
    deformation : of (P_sim, P_vis), on the result of the simulation deformation; None where the Gaussians carry values, to which
        the variation's transfer functions are applied as they are.
    simulation : the simulation deformation as it was tuned together with that; None where it is the base's, bit for bit.
    color_degree : of the Gaussians that it shows, at least that of the base.
    gaussians : canonical ones of its own, which `deformation` moves in place of the base's; None where it shows those.
    lighting : of the surfaces that its own Gaussians show.
    """

    variation: Variation
    deformation: Deformation | None
    simulation: BilinearDeformation | None = None
    color_degree: int = 0
    gaussians: Gaussians | None = None
    lighting: Lighting | None = None

    __repr__ = one_line

    def gaussians_at(self, gaussians: AnyGaussians, simulation: BilinearDeformation, parameters: Tensor) -> Gaussians:
        """The Gaussians that are drawn at normalized simulation and visualization parameters (P + V,), NaN ones for the base.

        `gaussians` are the canonical ones and `simulation` the base's simulation deformation.
        """
        count = len(self.variation.space)
        alone = parameters[:-count]  # [P]
        if any(map(math.isnan, parameters[-count:].tolist())):
            return simulation.deformed(gaussians, alone).drawn()
        if self.gaussians is not None:
            assert self.deformation is not None
            return replace(self.deformation.deformed(self.gaussians, parameters).drawn(), lighting=self.lighting)
        acted_on = self.simulation or simulation
        if isinstance(gaussians, FieldGaussians):
            simulated = acted_on.deformed(gaussians, alone)
            if self.deformation is None:
                return simulated.drawn(self.function(gaussians.field.base, parameters[-count:]))
            return self.deformation.deformed(self._wide(simulated.drawn()), parameters).drawn()
        assert self.deformation is not None
        return self._wide(compose(gaussians, (acted_on, alone), (self.deformation, parameters)).drawn())

    def function(self, base: TransferFunction, parameters: Tensor) -> TransferFunction:
        """The transfer function at normalized visualization parameters (V,), displacements of the base's control points."""
        steps = [parameter.high for parameter in self.variation.space.parameters]
        return displaced_by(base, steps, parameters)

    def simulated(self, gaussians: AnyGaussians, simulation: BilinearDeformation, parameters: Tensor) -> Gaussians:
        """The Gaussians that `deformation` acts on: at normalized simulation parameters (P,), or its own."""
        if self.gaussians is not None:
            return replace(self.gaussians, lighting=self.lighting)
        return self._wide((self.simulation or simulation).deformed(gaussians, parameters).drawn())

    def under(
        self, gaussians: AnyGaussians, simulation: BilinearDeformation, parameters: Tensor, function: TransferFunction
    ) -> Gaussians:
        """The Gaussians at normalized simulation parameters (P,) under any transfer function, of a variation that edits one."""
        assert isinstance(self.deformation, ValuesDeformation)
        return self.deformation.under(self.simulated(gaussians, simulation, parameters), function)

    def _wide(self, gaussians: Gaussians) -> Gaussians:
        """The same with colours of the degree that is shown, or of their own where that is higher."""
        degree = max(self.color_degree, gaussians.color_degree)
        return gaussians if degree == gaussians.color_degree else gaussians.with_color_degree(degree)

    def of(self, rows: Tensor) -> Visualization:
        """The same for some of the base's Gaussians, by index (M,); its own are all kept."""
        return self if self.gaussians is not None else self._changed(lambda deformation: deformation.of(rows))

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is trained, by name."""
        parts = {"deformation": self.deformation, "simulation": self.simulation, "gaussians": self.gaussians}
        return joined({name: part.tensors() for name, part in parts.items() if part is not None})

    def with_tensors(self, tensors: Mapping[str, Tensor]) -> Visualization:
        """The same with others for all of `tensors`."""
        tuned = self.simulation and self.simulation.with_tensors(part_of(tensors, "simulation"))
        learnt = self.deformation and self.deformation.with_tensors(part_of(tensors, "deformation"))
        own = self.gaussians and Gaussians.of_tensors(part_of(tensors, "gaussians"))
        return replace(self, deformation=learnt, simulation=tuned, gaussians=own)

    def to(self, device: torch.device | torch.dtype) -> Visualization:
        """The same on another device, or in another precision."""
        moved = self._changed(lambda deformation: deformation.to(device))
        return replace(moved, gaussians=self.gaussians and self.gaussians.to(device))

    def copy(self) -> Visualization:
        """The same numbers in tensors of their own."""
        copied = self._changed(lambda deformation: deformation.copy())
        return replace(copied, gaussians=self.gaussians and self.gaussians.copy())

    def _changed(self, change: Callable[[Any], Any]) -> Visualization:
        tuned = None if self.simulation is None else change(self.simulation)
        learnt = None if self.deformation is None else change(self.deformation)
        return replace(self, deformation=learnt, simulation=tuned)

    def record(self) -> dict[str, Any]:
        """JSON values that `load` needs beside the tensors."""
        own = {"lighting": self.lighting and self.lighting.to_json()} if self.gaussians is not None else {}
        return {
            "variation": self.variation.to_json(),
            "color_degree": self.color_degree,
            "deformation": self.deformation and self.deformation.record(),
            "simulation": self.simulation and self.simulation.record(),
        } | own

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> Visualization:
        """The visualization that had these `stored()` tensors and this `record()`; raises ValueError or KeyError where it can't."""
        degree, parts = record["color_degree"], ("deformation.", "simulation.", "gaussians.")
        if degree not in (0, 1) or not all(name.startswith(parts) for name in tensors):
            raise ValueError(
                f"color_degree must be 0 or 1, got {degree!r}, with tensors {joined_names(sorted(tensors))}"
            )
        of_vis, of_sim = record["deformation"], record["simulation"]
        of_own, own, lighting = part_of(tensors, "gaussians"), None, record.get("lighting")
        if of_own or "lighting" in record:
            own = Gaussians.of_tensors(of_own)
        if own is not None and lighting is not None and own.color_degree:
            raise ValueError("Gaussians of a lit surface have normals of 3 numbers, not colours of degree 1")
        return cls(
            variation_from_json(record["variation"]),
            None if of_vis is None else load_deformation(part_of(tensors, "deformation"), of_vis),
            None if of_sim is None else BilinearDeformation.load(part_of(tensors, "simulation"), of_sim),
            color_degree=int(degree),
            gaussians=own,
            lighting=None if lighting is None else Lighting.from_json(lighting),
        )

    def stored(self) -> dict[str, Tensor]:
        """All tensors: of both deformations, and of its own Gaussians."""
        parts = {"deformation": self.deformation, "simulation": self.simulation}
        tensors = {name: part.stored() for name, part in parts.items() if part is not None}
        return joined(tensors | ({} if self.gaussians is None else {"gaussians": self.gaussians.tensors()}))
