"""Base class of variations: a base appearance, a space of visualization parameters, and settings that sample it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Appearance, VolumeRendering
from catalogs.vocabulary.parameters import SPLITS, Outside, ParameterSpace
from catalogs.vocabulary.words import counted, joined_names


@dataclass(frozen=True)
class VariationSetting:
    """One appearance of a variation: its name, its visualization parameters (V,) and its split."""

    appearance: str
    values: tuple[float, ...]
    split: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", tuple(map(float, self.values)))
        if self.split not in SPLITS:
            raise ValueError(
                f"the split of {self.appearance} must be one of {joined_names(SPLITS)}, got {self.split!r}"
            )
        if not np.isfinite(self.values).all():
            raise ValueError(f"the visualization parameters of {self.appearance} must be finite, got {self.values}")


@dataclass(frozen=True)
class Variation(ABC):
    """Visualization parameters, P_vis, and the appearances that sample them.

    Attributes
    ----------
    kind : the name of the class in JSON and TOML.
    name, plural : of the varied quantity, in words.
    continuous : True where values between the settings are valid; a catalog's table has columns of them.
    field_values : names of the parameters in the field's unit, such as values and their differences.
    edits_base : True where the settings are the base with another transfer function; the base is zero, the middle of the space.
    base : name of the appearance that is varied.
    space : the visualization parameters.
    settings : the appearances beside the base.
    """

    kind: ClassVar[str]
    name: ClassVar[str]
    plural: ClassVar[str]
    continuous: ClassVar[bool] = True
    edits_base: ClassVar[bool] = False
    field_values: ClassVar[tuple[str, ...]] = ()

    base: str
    space: ParameterSpace
    settings: tuple[VariationSetting, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "settings", tuple(self.settings))
        names = self.parameter_names
        if self.space.names != names:
            raise ValueError(
                f"a variation of kind {self.kind} has the parameters {joined_names(names)}, got {joined_names(self.space.names)}"
            )
        if not self.trained:
            raise ValueError(f"the variation of {self.base} has no training settings")
        if any(len(s.values) != len(self.space) for s in self.settings):
            raise ValueError(
                f"every setting of {self.base} must have {len(self.space)} values, for {joined_names(names)}"
            )
        if any(s.appearance == self.base for s in self.settings):
            raise ValueError(f"the base {self.base} is among the settings of its own variation: leave it out")

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self}>"

    def __str__(self) -> str:
        splits = counted(setting.split for setting in self.settings)
        return f"{self.kind} of {self.base}: {len(self.settings)} settings ({splits}), {self.space}"

    @property
    @abstractmethod
    def parameter_names(self) -> tuple[str, ...]:
        """The names that `space` must have."""

    @property
    def trained(self) -> list[tuple[float, ...]]:
        """The values (V,) of each training setting."""
        return [s.values for s in self.settings if s.split == "train"]

    @property
    def argument_names(self) -> tuple[str, ...]:
        """Names of the arguments that select a setting: the parameters, or `appearance`."""
        return self.space.names

    def arguments(self, setting: VariationSetting) -> dict[str, float | str]:
        """The arguments, by name, that select a setting."""
        return dict(zip(self.space.names, setting.values, strict=True))

    def values_of(
        self, arguments: Mapping[str, Any], *, outside: Outside = "warn", stacklevel: int = 1
    ) -> tuple[float, ...] | None:
        """The visualization parameters (V,) for arguments by some of `argument_names`; None for the base appearance.

        Omitted displacements are zero.  Raises ValueError for an appearance outside the variation; raises and warns as
        `ParameterSpace.values` does.
        """
        whole = dict.fromkeys(self.space.names, 0.0) | dict(arguments)
        return tuple(self.space.values(whole, outside=outside, stacklevel=stacklevel + 1).tolist())

    def with_unit(self, unit: str) -> Variation:
        """The same with the field's `unit` for those of `field_values` that have none."""
        if not unit:
            return self
        parameters = tuple(
            replace(p, unit=unit) if p.name in self.field_values and not p.unit else p for p in self.space.parameters
        )
        return replace(self, space=ParameterSpace(parameters))

    def setting(self, appearance: str) -> VariationSetting | None:
        """The setting with this appearance, None for others."""
        return next((s for s in self.settings if s.appearance == appearance), None)

    def named(self, *splits: str) -> tuple[str, ...]:
        """Names of the appearances of these splits."""
        return tuple(s.appearance for s in self.settings if s.split in splits)

    def normalize(self, values: Sequence[float] | None) -> NDArray[np.float64]:
        """Visualization parameters (V,) scaled to about -1 to 1; for None those of the base, NaN where it has none."""
        return np.full(len(self.space), np.nan) if values is None else self.space.normalize(values)

    def mismatches(self, appearances: Sequence[Appearance]) -> list[str]:
        """A sentence for each setting whose values contradict its appearance; all appearances must be given."""
        by_name = {appearance.name: appearance for appearance in appearances}
        wrong = (s for s in self.settings if not self._shows(by_name[s.appearance], s.values, by_name[self.base]))
        return [f"{setting.appearance} does not show {self.arguments(setting)}" for setting in wrong]

    def to_json(self) -> dict[str, Any]:
        """JSON values that `variation_from_json` turns back into the same variation."""
        return {
            "kind": self.kind,
            "base": self.base,
            "parameters": self.space.to_json(),
            "settings": [asdict(setting) | {"values": list(setting.values)} for setting in self.settings],
        }

    @classmethod
    @abstractmethod
    def family(cls, base: VolumeRendering, scene_appearances: Sequence[str], **table: Any) -> Family:
        """The family of a scene's `[[variation]]` table; `scene_appearances` are the names of the scene's appearances.

        Raises ValueError or TypeError for an invalid table.
        """

    @abstractmethod
    def appearance_at(self, values: Sequence[float] | None, appearances: Sequence[Appearance]) -> Appearance:
        """The appearance that shows visualization parameters (V,), trained or not; the base for None.

        `appearances` are the catalog's, the base among them.  Raises ValueError where none can show these values.
        """

    @abstractmethod
    def _shows(self, appearance: Appearance, values: tuple[float, ...], base: Appearance) -> bool:
        """True where the appearance is the base with the values (V,)."""


def appearance_named(name: str, appearances: Sequence[Appearance]) -> Appearance:
    """The one of `appearances` with this name; raises ValueError where there is none."""
    for appearance in appearances:
        if appearance.name == name:
            return appearance
    raise ValueError(f"there is no appearance {name!r}, only {joined_names([a.name for a in appearances])}")


@dataclass(frozen=True)
class Family:
    """A variation and its appearances, the base left out."""

    variation: Variation
    appearances: tuple[Appearance, ...] = field(repr=False)
