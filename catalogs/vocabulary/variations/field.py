"""Variation of the field: a few appearances, one of which replaces the base."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Appearance, VolumeRendering
from catalogs.vocabulary.parameters import Outside, Parameter, ParameterSpace
from catalogs.vocabulary.variations.variation import Family, Variation, VariationSetting, appearance_named
from catalogs.vocabulary.words import joined_names, shortened

APPEARANCE = "appearance"


class FieldVariation(Variation):
    """Other appearances of the catalog, mostly of other fields, selected by name.

    Each setting has one parameter with the name of its appearance: 1 for the shown one and 0 for the others.  All settings are
    trained.
    """

    kind = "field"
    name = "field"
    plural = "other fields"
    continuous = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.array_equal(self.trained, np.eye(len(self.settings))):
            raise ValueError(
                f"every setting of the field of {self.base} must be trained, with a 1 in its own place, got {self.trained}"
            )

    def __str__(self) -> str:
        return f"field: {self.base}, or {shortened(self.parameter_names)}"

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(setting.appearance for setting in self.settings)

    @property
    def argument_names(self) -> tuple[str, ...]:
        return (APPEARANCE,)

    def arguments(self, setting: VariationSetting) -> dict[str, float | str]:
        return {APPEARANCE: setting.appearance}

    def values_of(
        self, arguments: Mapping[str, Any], *, outside: Outside = "warn", stacklevel: int = 1
    ) -> tuple[float, ...] | None:
        values = {self.base: None} | {s.appearance: s.values for s in self.settings}
        name = arguments[APPEARANCE]
        if not isinstance(name, str) or name not in values:
            raise ValueError(f"{APPEARANCE} must be one of {joined_names(values)}, got {name!r}")
        return values[name]

    def normalize(self, values: Sequence[float] | None) -> NDArray[np.float64]:
        """The values themselves; NaN for the base."""
        return super().normalize(None) if values is None else np.array(values, dtype=np.float64)

    @classmethod
    def family(cls, base: VolumeRendering, scene_appearances: Sequence[str], **table: Any) -> Family:
        variation = field_variation(base.name, **{"appearances": (), **table})
        unknown = [name for name in variation.space.names if name not in scene_appearances]
        if unknown:
            raise ValueError(
                f"appearances must name some of {joined_names(scene_appearances)}, each an [[appearance]] table, got "
                f"{joined_names(unknown)}"
            )
        return Family(variation, ())

    def appearance_at(self, values: Sequence[float] | None, appearances: Sequence[Appearance]) -> Appearance:
        name = self.base if values is None else self.settings[int(np.argmax(values))].appearance
        return appearance_named(name, appearances)

    def _shows(self, appearance: Appearance, values: tuple[float, ...], base: Appearance) -> bool:
        return True  # any appearance can show another field


def field_variation(base: str, *, appearances: Sequence[str]) -> FieldVariation:
    """Variation over other `appearances` of the catalog, by name, each of which can replace `base`.

    Examples
    --------
    >>> from insitu import field_variation
    >>> print(field_variation("pressure", appearances=["speed", "vorticity"]))
    field: pressure, or speed, vorticity
    """
    listed = [appearances] if isinstance(appearances, str) else appearances
    names: tuple[str, ...] = tuple(listed) if isinstance(listed, Iterable) else ()
    if not names or not all(isinstance(n, str) for n in names) or len(set(names)) != len(names) or base in names:
        raise ValueError(
            f"appearances must name some beside the base {base}, each once, got {list(names) or appearances!r}"
        )
    rows = np.eye(len(names)).tolist()
    settings = tuple(VariationSetting(name, tuple(row), "train") for name, row in zip(names, rows, strict=True))
    return FieldVariation(base, ParameterSpace(tuple(Parameter(name, 0.0, 1.0) for name in names)), settings)
