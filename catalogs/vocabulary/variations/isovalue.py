"""Variation of the isovalue: a family of isosurfaces beside the base volume rendering."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Appearance, Isosurface, VolumeRendering, appearance_from_json
from catalogs.vocabulary.parameters import SPLITS, Parameter, ParameterSpace
from catalogs.vocabulary.variations.variation import Family, Variation, VariationSetting, appearance_named

ISOVALUE = "isovalue"


class IsovalueVariation(Variation):
    """Isosurfaces by their isovalue; at least two are trained, all different."""

    kind = "isovalue"
    name = "isovalue"
    plural = "isovalues"
    parameter_names = (ISOVALUE,)
    field_values = (ISOVALUE,)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.trained) < 2 or len(set(self.trained)) != len(self.trained):
            raise ValueError(
                f"at least two isovalues must be trained, all different, got {self.trained} of {self.base}"
            )

    @classmethod
    def family(cls, base: VolumeRendering, scene_appearances: Sequence[str], **table: Any) -> Family:
        style = ({"field": base.field} if base.field else {}) | table.pop("style", {})
        return isovalue_family(base.name, style=style, **table)

    def normalize(self, values: Sequence[float] | None) -> NDArray[np.float64]:
        """Piecewise linear, with the trained isovalues at equal distances in [-1, 1]."""
        if values is None:
            return super().normalize(None)
        trained = np.array(sorted(value for (value,) in self.trained))  # [T]
        even = np.linspace(-1.0, 1.0, len(trained))
        slopes = np.diff(even) / np.diff(trained)  # [T - 1]
        below = min(values[0] - trained[0], 0.0) * slopes[0]
        above = max(values[0] - trained[-1], 0.0) * slopes[-1]
        return np.array([np.interp(values[0], trained, even) + below + above])

    def appearance_at(self, values: Sequence[float] | None, appearances: Sequence[Appearance]) -> Appearance:
        surface = appearance_named(self.base if values is None else self.settings[0].appearance, appearances)
        if values is None or not isinstance(surface, Isosurface):
            return surface
        return replace(surface, isovalue=float(values[0]))

    def _shows(self, appearance: Appearance, values: tuple[float, ...], base: Appearance) -> bool:
        return isinstance(appearance, Isosurface) and (appearance.isovalue,) == values


def isovalue_family(
    base: str,
    *,
    train: Sequence[float],
    validation: Sequence[float] = (),
    test: Sequence[float] = (),
    style: Mapping[str, Any] | None = None,
    unit: str = "",
) -> Family:
    """Isosurfaces at the given isovalues beside the volume rendering `base`.

    `style` are further arguments of `Isosurface`, such as its colour.  The parameter's bounds are the lowest and highest trained
    isovalue, which must differ; all others must lie between them.

    Examples
    --------
    >>> from insitu import isovalue_family
    >>> family = isovalue_family("blobs", train=[0.2, 0.5, 0.8], test=[0.35], style={"color": (0.9, 0.6, 0.2)})
    >>> [surface.name for surface in family.appearances]
    ['iso=0.2', 'iso=0.5', 'iso=0.8', 'iso=0.35']

    Draw them all: `appearances=[volume, *family.appearances], variations=[family.variation]`.
    """
    rows = [(split, float(v)) for split, vs in zip(SPLITS, (train, validation, test), strict=True) for v in vs]
    values = [value for _, value in rows]
    reserved = sorted({"kind", "name", "isovalue"} & set(style or {}))
    if reserved:
        raise ValueError(
            f"style holds what all isosurfaces share, such as color, not {reserved}: those are set by isovalue"
        )
    if len(set(train)) < 2 or len(set(values)) != len(values):
        raise ValueError(f"isovalues must differ, and at least two be trained, got {values}")
    low, high = float(min(train)), float(max(train))
    if not all(low <= value <= high for value in values):
        raise ValueError(f"every isovalue must lie within the trained ones, {low:g} to {high:g}, got {values}")
    settings = tuple(VariationSetting(f"iso={_digits(value)}", (value,), split) for split, value in rows)
    form = {"kind": "isosurface", **(style or {})}
    surfaces = tuple(appearance_from_json({**form, "name": s.appearance, "isovalue": s.values[0]}) for s in settings)
    space = ParameterSpace((Parameter(ISOVALUE, low, high, unit),))
    return Family(IsovalueVariation(base, space, settings), surfaces)


def _digits(value: float) -> str:
    """A number for a name: six digits if exact, else as many as needed."""
    return f"{value:g}" if float(f"{value:g}") == value else repr(value)
