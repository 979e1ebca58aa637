"""Settings as points in the spaces of a surrogate's parameters, as fractions of their ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.parameters import SPLITS, ParameterSpace
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.words import joined_names
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate

RANGE = 2.0  # of normalized values, from -1 to 1
ISOSURFACES = ":isovalue"  # no appearance can be called so


@dataclass(frozen=True)
class SettingPoint:
    """A setting in numbers that distances are taken of.

    Attributes
    ----------
    family : settings that can be compared: the base appearance, under any transfer function too; `ISOSURFACES`; another field's
        appearance.
    values : (P + V,) simulation and visualization parameters as fractions of their ranges; V is 0 where the family has none.
    outside : names of the parameters that lie out of bounds.
    drawn_by : the one of `Surrogate.representations` that draws it.
    """

    family: str
    values: NDArray[np.float64]  # [P + V]
    outside: tuple[str, ...]
    drawn_by: str


def base_name(surrogate: Surrogate) -> str:
    """The name of the appearance that the surrogate shows without visualization parameters; "" where nobody said."""
    varied = [v.base for v in surrogate.variations]
    return str(surrogate.training.get("appearance", varied[0] if varied else ""))


def appearances_of(surrogate: Surrogate, splits: Sequence[str] = SPLITS) -> dict[str, Mapping[str, float | str]]:
    """The appearances that the surrogate follows, the base first, with the visualization parameters that show them.

    Beside the base only those of these splits.
    """
    variations = surrogate.variations
    others = {s.appearance: v.arguments(s) for v in variations for s in v.settings if s.split in splits}
    return {base_name(surrogate): {}, **others}


def point_of(setting: Setting, surrogate: Surrogate) -> SettingPoint:
    """The point of `setting`; raises ValueError for parameters that are missing, unknown or not finite."""
    simulation = surrogate.space.values(setting.parameters, outside="allow")  # [P]
    variation, varied = variation_of(setting.visualization, surrogate.variations)
    outside, family, within = [*surrogate.space.outside(simulation)], base_name(surrogate), np.zeros(0)
    if variation is not None and variation.continuous:
        outside += variation.space.outside(varied)
        family, within = family if variation.edits_base else ISOSURFACES, variation.normalize(varied) / RANGE
    elif variation is not None:
        family = next(s.appearance for s in variation.settings if s.values == varied)
    values = np.concatenate([surrogate.space.normalize(simulation) / RANGE, within])
    return SettingPoint(family, values, tuple(outside), setting.drawn_by(surrogate))


def values_of(space: ParameterSpace, rows: Sequence[Mapping[str, float]]) -> NDArray[np.float64]:
    """Simulation parameters by name, N of them, as an array (N, P)."""
    return np.array([[row[name] for name in space.names] for row in rows], np.float64).reshape(len(rows), len(space))


def fractions_of(space: ParameterSpace, rows: Sequence[Mapping[str, float]]) -> NDArray[np.float64]:
    """The same as fractions of their ranges (N, P)."""
    return space.normalize(values_of(space, rows)) / RANGE


def variation_of(
    visualization: Mapping[str, float | str], variations: Sequence[Variation]
) -> tuple[Variation | None, tuple[float, ...]]:
    """The variation whose parameters these are, and all their values (V,).

    The base appearance is that of transfer functions without displacement; None and no values where none are followed.  Raises
    ValueError as `Variation.values_of` does, and for names of no variation; values out of bounds are taken silently.
    """
    of = next((v for v in variations if visualization and set(visualization) <= set(v.argument_names)), None)
    if visualization and of is None:
        raise ValueError(f"no variation has the parameters {joined_names(sorted(visualization))}")
    values = None if of is None else of.values_of(visualization, outside="allow")
    if values is not None:
        return of, values
    base = next((v for v in variations if v.edits_base), None)
    return base, () if base is None else (0.0,) * len(base.space)
