"""Settings in the spaces of a surrogate's parameters: the appearances and variations that they are of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.words import joined_names
from surrogate.model import Surrogate


def appearances_of(surrogate: Surrogate) -> dict[str, Mapping[str, float | str]]:
    """The appearances that the surrogate follows, the base first, with the visualization parameters that show them."""
    others = {s.appearance: v.arguments(s) for v in surrogate.variations for s in v.settings}
    return {surrogate.base_appearance: {}, **others}


def values_of(space: ParameterSpace, rows: Sequence[Mapping[str, float]]) -> NDArray[np.float64]:
    """Simulation parameters by name, N of them, as an array (N, P)."""
    return np.array([[row[name] for name in space.names] for row in rows], np.float64).reshape(len(rows), len(space))


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
