"""Where a setting lies in the spaces of a surrogate's parameters, as fractions of their ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.parameters import ParameterSpace
from catalogs.variations import Variation
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate

RANGE = 2.0  # of normalized values, from -1 to 1
ISOSURFACES = ":isovalue"  # no appearance can be called so


@dataclass(frozen=True)
class Place:
    """A setting in numbers that distances are taken of.

    Attributes
    ----------
    family : what can be compared: the base appearance, under any transfer function too; `ISOSURFACES`; another field's appearance.
    values : (P + V,) simulation and visualization parameters as fractions of their ranges; V is 0 where the family has none.
    outside : names of the parameters that lie out of bounds.
    """

    family: str
    values: NDArray[np.float64]  # [P + V]
    outside: tuple[str, ...]


def base_name(surrogate: Surrogate) -> str:
    """The name of the appearance that the surrogate shows without visualization parameters; "" where nobody said."""
    varied = [v.variation.base for v in surrogate.visualizations]
    return str(surrogate.training.get("appearance", varied[0] if varied else ""))


def place_of(setting: Setting, surrogate: Surrogate) -> Place:
    """Where `setting` lies.

    Raises ValueError for parameters that are missing, unknown or not finite.
    """
    simulation = surrogate.space.values(setting.parameters, outside="allow")  # [P]
    outside = [*surrogate.space.outside(simulation)]
    variation, values = asked(setting.visualization, [v.variation for v in surrogate.visualizations])
    if variation is not None and values is not None and variation.continuous:
        outside += variation.space.outside(values)
    family, within = _of_family(variation, values, surrogate)
    return Place(family, np.concatenate([surrogate.space.normalize(simulation) / RANGE, within]), tuple(outside))


def fractions_of(space: ParameterSpace, rows: Sequence[Mapping[str, float]]) -> NDArray[np.float64]:
    """Simulation parameters by name, N of them, as fractions of their ranges (N, P)."""
    values = np.array([[row[name] for name in space.names] for row in rows], dtype=np.float64)
    return space.normalize(values.reshape(len(rows), len(space))) / RANGE


def asked(
    visualization: Mapping[str, float | str], variations: Sequence[Variation]
) -> tuple[Variation | None, tuple[float, ...] | None]:
    """The variation whose parameters these are, and all their values (V,); None and None for the base appearance.

    Raises ValueError as `Variation.values_of` does, and for names of no variation; values out of bounds are taken silently.
    """
    if not visualization:
        return None, None
    for variation in variations:
        if set(visualization) <= set(variation.asked_names):
            values = variation.values_of(visualization, outside="allow")
            return (None, None) if values is None else (variation, values)
    raise ValueError(f"no variation has the parameters {sorted(visualization)}")


def _of_family(
    variation: Variation | None, values: tuple[float, ...] | None, surrogate: Surrogate
) -> tuple[str, NDArray[np.float64]]:
    """The family, and the visualization parameters within it as fractions of their ranges."""
    if variation is None or values is None:
        functions = next((v.variation for v in surrogate.visualizations if v.variation.edits_base), None)
        return base_name(surrogate), np.zeros(0) if functions is None else functions.normalize(None) / RANGE
    if not variation.continuous:
        return next(s.appearance for s in variation.settings if s.values == values), np.zeros(0)
    family = base_name(surrogate) if variation.edits_base else ISOSURFACES
    return family, variation.normalize(values) / RANGE
