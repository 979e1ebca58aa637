"""Validated points in parameter space, by name and as deformations take them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.parameters import SLACK, Parameter, ParameterSpace
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians
from surrogate.model.deformed import named

# Widths of its bounds by which a parameter may lie outside them: what is learnt says nothing of farther values.
BEYOND = 1.0


@dataclass(frozen=True, eq=False)
class ParameterPoint:
    """Parameters of one member, as they are seen.

    Attributes
    ----------
    parameters : by name, in their units.
    simulation : (P,) normalized.
    visualization : the one that is asked, with its normalized parameters `settings` (V,), or any transfer `function` instead.
    warnings : a sentence about each parameter that is out of bounds.
    """

    parameters: Mapping[str, float | str]
    simulation: NDArray[np.float64]  # [P]
    visualization: Visualization | None = None
    settings: NDArray[np.float64] | None = None  # [V]
    function: TransferFunction | None = None
    warnings: tuple[str, ...] = ()

    __repr__ = one_line

    @property
    def normalized(self) -> torch.Tensor:
        """All that deformations are functions of, (P + V,) float32; (P,) where no visualization parameters are given."""
        parts = [self.simulation] if self.settings is None else [self.simulation, self.settings]
        return torch.from_numpy(np.concatenate(parts)).to(torch.float32)

    def deform(self, gaussians: AnyGaussians, simulation: BilinearDeformation) -> Gaussians:
        """The canonical `gaussians` as they are drawn here; raises ValueError where they are not finite."""
        with torch.no_grad():
            return self.deformed(gaussians, simulation, self.normalized)

    def deformed(self, gaussians: AnyGaussians, simulation: BilinearDeformation, normalized: torch.Tensor) -> Gaussians:
        """The same at `normalized` parameters (P + V,), which torch can differentiate."""
        if self.function is not None and isinstance(gaussians, FieldGaussians):
            deformed = simulation.deformed(gaussians, normalized).drawn(self.function)
        elif self.visualization is None:
            deformed = simulation.deformed(gaussians, normalized).drawn()
        elif self.function is not None:
            deformed = self.visualization.under(gaussians, simulation, normalized, self.function)
        else:
            deformed = self.visualization.gaussians_at(gaussians, simulation, normalized)
        if self.warnings:
            self._check_finite(deformed)
        return deformed

    def _check_finite(self, deformed: Gaussians) -> None:
        """Raise ValueError where Gaussians here can't be drawn."""
        tensors = (deformed.means, deformed.scales(), deformed.quats, deformed.opacities(), deformed.colors)
        if not all(bool(torch.isfinite(tensor).all()) for tensor in tensors):
            raise ValueError(
                f"the surrogate extrapolates to numbers that are not finite at {named(self.parameters)}: choose values nearer "
                "the bounds"
            )


def place_of(
    space: ParameterSpace, visualizations: Sequence[Visualization], parameters: Mapping[str, Any], outside: Any
) -> ParameterPoint:
    """The place of simulation parameters, all of them by name, and of visualization parameters of one variation.

    Raises ValueError for missing, unknown, non-finite and absurd ones, or where no variation has them; `outside` says whether
    others out of bounds leave `warnings`.
    """
    place, varied = separated(space, [v.variation for v in visualizations], parameters, outside)
    if varied is None:
        return place
    return replace(
        place,
        parameters={**place.parameters, **varied.parameters},
        visualization=visualizations[varied.number],
        settings=visualizations[varied.number].variation.normalize(varied.values),
        warnings=place.warnings + varied.warnings,
    )


@dataclass(frozen=True)
class VariedPoint:
    """Visualization parameters of one of several variations.

    Attributes
    ----------
    number : of the variation.
    parameters : all of its arguments by name.
    values : (V,), None for the base appearance.
    warnings : a sentence about each parameter that is out of bounds.
    """

    number: int
    parameters: Mapping[str, float | str]
    values: tuple[float, ...] | None
    warnings: tuple[str, ...]


def separated(
    space: ParameterSpace, variations: Sequence[Variation], parameters: Mapping[str, Any], outside: Any
) -> tuple[ParameterPoint, VariedPoint | None]:
    """The place of the simulation's parameters among `parameters`, and that of a variation's, if any; raises as `place_of`."""
    arguments = {name for v in variations for name in v.argument_names}
    varied = {n: v for n, v in parameters.items() if n in arguments}
    place = simulation_place(space, {n: v for n, v in parameters.items() if n not in varied}, outside)
    if not varied:
        return place, None
    number = _varying(variations, varied)
    variation = variations[number]
    values = variation.values_of(varied, outside="allow")  # [V]
    if values is not None:
        _check_near(variation.space, values)
    warnings = () if values is None else tuple(variation.space.outside(values).values())
    whole = {**dict.fromkeys(variation.argument_names, 0.0), **varied}
    return place, VariedPoint(number, whole, values, warnings)


def simulation_place(space: ParameterSpace, parameters: Mapping[str, Any], outside: Any) -> ParameterPoint:
    """The place of simulation parameters alone."""
    if outside not in ("warn", "allow"):
        raise ValueError(f'outside must be "warn" or "allow", got {outside!r}')
    values = space.values(parameters, outside="allow")  # [P]
    _check_near(space, values)
    by_name = dict(zip(space.names, values.tolist(), strict=True))
    return ParameterPoint(by_name, space.normalize(values), warnings=tuple(space.outside(values).values()))


def transfer_place(
    space: ParameterSpace,
    visualizations: Sequence[Visualization],
    parameters: Mapping[str, Any],
    function: TransferFunction,
    outside: Any,
    *,
    carried: bool = False,
) -> ParameterPoint:
    """The place of simulation parameters under any transfer function.

    `carried` says that the Gaussians carry the field's values.  Raises ValueError where neither they nor a variation know any.
    """
    place = simulation_place(space, parameters, outside)
    if carried:
        return replace(place, function=function)
    candidates = [v for v in visualizations if v.variation.edits_base]
    if not candidates:
        raise ValueError(
            'the Gaussians of this surrogate carry colours and know no transfer functions: train with carried = "values"'
        )
    return ParameterPoint(place.parameters, place.simulation, candidates[0], function=function, warnings=place.warnings)


def limits(parameter: Parameter) -> tuple[float, float]:
    """From where to where a parameter can be drawn: `BEYOND` widths outside its bounds, on its own scale."""
    return parameter.at(-BEYOND), parameter.at(1.0 + BEYOND)


def beyond_limits(parameter: Parameter, value: float, origin: float = 0.0) -> str:
    """A sentence where a value lies outside the `limits`, else ""; numbers in it are counted from -`origin` on."""
    least, most = limits(parameter)
    slack = SLACK * (most - least)
    if least - slack <= value <= most + slack:
        return ""
    numbers = (value, parameter.low, parameter.high, least, most)
    said, low, high, first, last = (parameter.text(number + origin) for number in numbers)
    return f"{parameter.name} = {said} lies too far outside its bounds [{low}, {high}]: it can be drawn from {first} to {last}"


def _check_near(space: ParameterSpace, values: Sequence[float] | NDArray[np.float64]) -> None:
    for parameter, value in zip(space.parameters, values, strict=True):
        if sentence := beyond_limits(parameter, float(value)):
            raise ValueError(sentence)


def _varying(variations: Sequence[Variation], parameters: Mapping[str, Any]) -> int:
    """The number of the variation that has all these parameters."""
    for number, variation in enumerate(variations):
        if set(parameters) <= set(variation.argument_names):
            return number
    raise ValueError(f"parameters {joined_names(sorted(parameters))} belong to different variations: set those of one")
