"""Families of appearances: one base, varied by visualization parameters that an explorer may set freely afterwards.

An isovalue varies over a family of isosurfaces beside the base volume rendering.  A transfer function varies by the displacement
of its two inner control points from those of the base.  A field varies over a few appearances, one of which is shown instead of
the base: there is nothing between them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import (
    Appearance,
    Isosurface,
    TransferFunction,
    VolumeRendering,
    appearance_from_json,
    field_of,
)
from catalogs.parameters import SPLITS, Outside, Parameter, ParameterSpace

Kind = Literal["isovalue", "transfer_function", "field"]
KINDS: tuple[Kind, ...] = ("isovalue", "transfer_function", "field")
POINT_PARAMETERS = ("c1_value", "c1_opacity", "c2_value", "c2_opacity")
ISOVALUE, APPEARANCE = "isovalue", "appearance"
SINGLE_STEPS = (-1.0, 0.5, 1.0)  # steps by which one coordinate of one control point is moved alone


@dataclass(frozen=True)
class Setting:
    """One appearance of a variation: its name, its visualization parameters (V,) and its split."""

    appearance: str
    values: tuple[float, ...]
    split: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", tuple(map(float, self.values)))
        if self.split not in SPLITS:
            raise ValueError(f"the split of {self.appearance} must be one of {SPLITS}, got {self.split!r}")
        if not np.isfinite(self.values).all():
            raise ValueError(f"the visualization parameters of {self.appearance} must be finite, got {self.values}")


@dataclass(frozen=True)
class Variation:
    """Visualization parameters, P_vis, and the appearances that sample them.

    Attributes
    ----------
    kind : "isovalue", "transfer_function" or "field".
    base : name of the appearance that is varied.
    space : the visualization parameters; of a transfer function the displacements of its inner control points,
        `POINT_PARAMETERS`, zero at the base: values in the field's unit, opacities per `opacity_unit_distance`; of a field one
        per setting, called like its appearance: 1 for that which is shown and 0 for the others.
    settings : the appearances beside the base; of a field all are trained.
    """

    kind: Kind
    base: str
    space: ParameterSpace
    settings: tuple[Setting, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "settings", tuple(self.settings))
        if self.kind not in KINDS:
            raise ValueError(f"the kind of a variation must be one of {KINDS}, got {self.kind!r}")
        expected = self._expected_names()
        if self.space.names != expected:
            raise ValueError(f"a variation of kind {self.kind} has the parameters {expected}, got {self.space.names}")
        if not any(s.split == "train" for s in self.settings):
            raise ValueError(f"the variation of {self.base} has no training settings")
        if any(len(s.values) != len(self.space) for s in self.settings):
            raise ValueError(f"every setting of {self.base} must have {len(self.space)} values, for {expected}")
        if any(s.appearance == self.base for s in self.settings):
            raise ValueError(f"the base {self.base} stands among the settings of its own variation: leave it out")
        trained = [s.values for s in self.settings if s.split == "train"]
        if self.kind == "isovalue" and (len(trained) < 2 or len(set(trained)) != len(trained)):
            raise ValueError(f"at least two isovalues must be trained, all different, got {trained} of {self.base}")
        if self.kind == "field" and not np.array_equal(trained, np.eye(len(self.settings))):
            raise ValueError(
                f"every setting of the field of {self.base} must be trained, with a 1 in its own place, got {trained}"
            )

    def _expected_names(self) -> tuple[str, ...]:
        if self.kind == "field":
            return tuple(setting.appearance for setting in self.settings)
        return (ISOVALUE,) if self.kind == "isovalue" else POINT_PARAMETERS

    @property
    def in_table(self) -> bool:
        """Whether a catalog's table has columns of the parameters: of a field the appearance says it all."""
        return self.kind != "field"

    def setting(self, appearance: str) -> Setting | None:
        """The setting with this appearance, None for others."""
        return next((s for s in self.settings if s.appearance == appearance), None)

    def normalize(self, values: Sequence[float] | None) -> NDArray[np.float64]:
        """Visualization parameters (V,) as a network sees them, about -1 to 1; of the base for None.

        Isovalues are mapped so that the trained ones lie at equal distances, as they were chosen to (linearly between and
        beyond them); the base, which has none, is NaN.  Displacements are in units of their largest; the base is zero.  Fields are
        as they are, a single 1; the base, at which no network is asked, is NaN.
        """
        if self.kind == "transfer_function":
            return self.space.normalize(np.zeros(len(self.space)) if values is None else values)
        if values is None:
            return np.full(len(self.space), np.nan)
        if self.kind == "field":
            return np.array(values, dtype=np.float64)
        trained = np.array(sorted(s.values[0] for s in self.settings if s.split == "train"))  # [T]
        even = np.linspace(-1.0, 1.0, len(trained))
        slopes = np.diff(even) / np.diff(trained)  # [T - 1]
        below = min(values[0] - trained[0], 0.0) * slopes[0]
        above = max(values[0] - trained[-1], 0.0) * slopes[-1]
        return np.array([np.interp(values[0], trained, even) + below + above])

    def asked(self, setting: Setting) -> dict[str, float | str]:
        """What a surrogate is asked for by name to show a setting: its parameters, or the `appearance` instead of the base."""
        if self.kind == "field":
            return {APPEARANCE: setting.appearance}
        return dict(zip(self.space.names, setting.values, strict=True))

    @property
    def asked_names(self) -> tuple[str, ...]:
        """What `asked` names."""
        return (APPEARANCE,) if self.kind == "field" else self.space.names

    def values_of(
        self, asked: Mapping[str, Any], *, outside: Outside = "warn", stacklevel: int = 1
    ) -> tuple[float, ...] | None:
        """The visualization parameters (V,) of what is asked for by some of `asked_names`; None for the base appearance.

        Displacements that are left out are zero.  Raises ValueError for an appearance that is none of the variation's; raises and
        warns as `ParameterSpace.values` does.
        """
        if self.kind != "field":
            whole = dict.fromkeys(self.space.names, 0.0) | dict(asked)
            return tuple(self.space.values(whole, outside=outside, stacklevel=stacklevel + 1).tolist())
        name = asked[APPEARANCE] if isinstance(asked[APPEARANCE], str) else ""
        if name == self.base:
            return None
        setting = self.setting(name)
        if setting is None:
            known = [self.base, *(s.appearance for s in self.settings)]
            raise ValueError(f"{APPEARANCE} must be one of {known}, got {asked[APPEARANCE]!r}")
        return setting.values

    def named(self, *splits: str) -> tuple[str, ...]:
        """Names of the appearances of these splits."""
        return tuple(s.appearance for s in self.settings if s.split in splits)

    def to_json(self) -> dict[str, Any]:
        return {
            "kind": self.kind,
            "base": self.base,
            "parameters": self.space.to_json(),
            "settings": [
                {"appearance": s.appearance, "values": list(s.values), "split": s.split} for s in self.settings
            ],
        }

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Variation:
        settings = (Setting(s["appearance"], tuple(s["values"]), s["split"]) for s in record["settings"])
        return cls(record["kind"], record["base"], ParameterSpace.from_json(record["parameters"]), tuple(settings))


@dataclass(frozen=True)
class Family:
    """A variation and its appearances, the base left out."""

    variation: Variation
    appearances: tuple[Appearance, ...]


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

    `style` are further arguments of `Isosurface`, such as its colour.  The parameter's bounds are those of the isovalues to
    learn from, of which two must differ; the others must lie between them.
    """
    rows = [(split, float(v)) for split, vs in zip(SPLITS, (train, validation, test), strict=True) for v in vs]
    values = [value for _, value in rows]
    taken = sorted({"kind", "name", "isovalue"} & set(style or {}))
    if taken:
        raise ValueError(
            f"style holds what all isosurfaces share, such as color, not {taken}: those are set by isovalue"
        )
    if len(set(train)) < 2 or len(set(values)) != len(values):
        raise ValueError(f"isovalues must differ, and at least two be trained, got {values}")
    low, high = float(min(train)), float(max(train))
    if not all(low <= value <= high for value in values):
        raise ValueError(f"every isovalue must lie within the trained ones, {low:g} to {high:g}, got {values}")
    settings = tuple(Setting(f"iso={_digits(value)}", (value,), split) for split, value in rows)
    form = {"kind": "isosurface", **(style or {})}
    surfaces = tuple(appearance_from_json({**form, "name": s.appearance, "isovalue": s.values[0]}) for s in settings)
    space = ParameterSpace((Parameter(ISOVALUE, low, high, unit),))
    return Family(Variation("isovalue", base, space, settings), surfaces)


def transfer_function_family(
    base: VolumeRendering,
    *,
    first_step: Sequence[float],
    second_step: Sequence[float],
    single_steps: Sequence[float] = SINGLE_STEPS,
    validation: int = 8,
    test: int = 20,
    seed: int = 0,
    unit: str = "",
) -> Family:
    """The 76 training transfer functions around `base`, and others that only judge, drawn evenly from the same box by `seed`.

    GS-Surrogate, transfer-function editing: both inner control points are displaced by every pair of the 8 displacements
    {-, 0, +}² without the zero (64 functions), and one coordinate of one point alone by each of three steps (12).

    Parameters
    ----------
    base : an opacity function of four control points: fixed ends of opacity 0 and 1, and c1, c2 between them.
    first_step, second_step : (value, opacity) by which c1 and c2 are displaced.
    single_steps : the three steps of the single displacements, as multiples.

    Raises ValueError naming the function where a displaced point would leave its place between its neighbours, or [0, 1].
    """
    points = base.transfer_function.opacity_points
    if len(points) != 4 or (points[0][1], points[3][1]) != (0.0, 1.0):
        raise ValueError(
            f"appearance {base.name}: a transfer function to be varied has four opacity points, the ends of opacity "
            f"0 and 1, got {points}"
        )
    steps = np.array([*first_step, *second_step], dtype=np.float64)  # [4]
    if len(first_step) != 2 or len(second_step) != 2 or not (np.isfinite(steps) & (steps > 0)).all():
        raise ValueError(
            f"first_step and second_step must be a positive (value, opacity) each, got {first_step} and {second_step}"
        )
    if validation < 0 or test < 0:
        raise ValueError(f"validation and test count transfer functions, from 0 on, got {validation} and {test}")
    trained = [*_joint_displacements(), *_single_displacements(single_steps)]
    random = np.random.default_rng(seed)
    rows = {"train": np.array(trained)}  # [76, 4]
    rows |= {
        split: random.uniform(-1.0, 1.0, (count, 4)) for split, count in (("validation", validation), ("test", test))
    }
    decimals = [_decimals(step) for step in steps.tolist()]
    settings, shown = [], []
    for split, displacements in rows.items():
        for i, moved in enumerate((displacements * steps).tolist(), start=1):
            displacement = tuple(map(round, moved, decimals))
            name = f"{base.name}-{split}-{i:02d}"
            settings.append(Setting(name, displacement, split))
            shown.append(_displaced_appearance(base, name, displacement))
    space = ParameterSpace(
        tuple(
            Parameter(name, -step, step, unit if name.endswith("value") else "")
            for name, step in zip(POINT_PARAMETERS, steps.tolist(), strict=True)
        )
    )
    return Family(Variation("transfer_function", base.name, space, tuple(settings)), tuple(shown))


def field_variation(base: str, *, appearances: Sequence[str]) -> Variation:
    """Other `appearances` of the catalog, by name, any one of which is shown instead of `base`: mostly those of other fields."""
    listed = [appearances] if isinstance(appearances, str) else appearances
    names: tuple[str, ...] = tuple(listed) if isinstance(listed, Iterable) else ()
    if not names or not all(isinstance(n, str) for n in names) or len(set(names)) != len(names) or base in names:
        raise ValueError(
            f"appearances must name some beside the base {base}, each once, got {list(names) or appearances!r}"
        )
    rows = np.eye(len(names)).tolist()
    settings = tuple(Setting(name, tuple(row), "train") for name, row in zip(names, rows, strict=True))
    return Variation("field", base, ParameterSpace(tuple(Parameter(name, 0.0, 1.0) for name in names)), settings)


def displaced(base: TransferFunction, displacement: Sequence[float]) -> TransferFunction:
    """`base` with its inner control points moved by (4,) `POINT_PARAMETERS`; raises ValueError where they cross or leave [0, 1]."""
    ends, (first, second) = (base.opacity_points[0], base.opacity_points[3]), base.opacity_points[1:3]
    moved_first = (first[0] + displacement[0], first[1] + displacement[1])
    moved_second = (second[0] + displacement[2], second[1] + displacement[3])
    return replace(base, opacity_points=(ends[0], moved_first, moved_second, ends[1]))


def mismatches(variation: Variation, appearances: Sequence[Appearance]) -> list[str]:
    """Sentences naming each setting whose appearance shows something else than its values say; names must be known."""
    if variation.kind == "field":
        return []  # any appearance may stand for a field
    named = {appearance.name: appearance for appearance in appearances}
    base = _four_points(named[variation.base])
    if variation.kind == "transfer_function" and base is None:
        return [f"the base {variation.base} is no volume rendering of four opacity points"]
    return [
        f"{setting.appearance} does not show {variation.asked(setting)}"
        for setting in variation.settings
        if not _shows(named[setting.appearance], setting, base)
    ] + _of_other_fields(variation, named)


def _four_points(appearance: Appearance) -> TransferFunction | None:
    """The transfer function, if it is one of four opacity points."""
    if not isinstance(appearance, VolumeRendering) or len(appearance.transfer_function.opacity_points) != 4:
        return None
    return appearance.transfer_function


def _shows(appearance: Appearance, setting: Setting, base: TransferFunction | None) -> bool:
    if len(setting.values) == 1:
        return isinstance(appearance, Isosurface) and appearance.isovalue == setting.values[0]
    try:
        return base is not None and _four_points(appearance) == displaced(base, setting.values)
    except ValueError:
        return False


def _of_other_fields(variation: Variation, named: Mapping[str, Appearance]) -> list[str]:
    """Sentences naming each transfer function that is applied to another field than the base's."""
    if variation.kind != "transfer_function":
        return []  # surfaces of another field may stand beside a volume
    field = field_of(named[variation.base])
    others = [s.appearance for s in variation.settings if field_of(named[s.appearance]) != field]
    return [f"{name} shows the field {field_of(named[name])!r}, its base {field!r}" for name in others]


def _displaced_appearance(base: VolumeRendering, name: str, displacement: Sequence[float]) -> VolumeRendering:
    try:
        return replace(base, name=name, transfer_function=displaced(base.transfer_function, displacement))
    except ValueError as error:
        given = dict(zip(POINT_PARAMETERS, displacement, strict=True))
        raise ValueError(
            f"{name} moves the control points of {base.name} by {given} too far: {error}; take smaller steps, or a base "
            "whose points lie farther from each other and from 0 and 1"
        ) from None


def _digits(value: float) -> str:
    """A number for a name: six digits where they say it all, else as many as it takes."""
    return f"{value:g}" if float(f"{value:g}") == value else repr(value)


def _decimals(step: float) -> int:
    """Decimals to which displacements are rounded: nine, and more where a step is so small that it needs them."""
    return max(9, 6 - math.floor(math.log10(step)))


def _joint_displacements() -> list[tuple[float, ...]]:
    signs = [pair for pair in itertools.product((-1.0, 0.0, 1.0), repeat=2) if pair != (0.0, 0.0)]
    return [(*first, *second) for first in signs for second in signs]


def _single_displacements(steps: Sequence[float]) -> list[tuple[float, ...]]:
    if len(set(steps)) != 3 or len(steps) != 3 or 0.0 in steps or not all(-1.0 <= step <= 1.0 for step in steps):
        raise ValueError(
            f"single_steps must be three different multiples of the steps, in [-1, 1] and none of them zero, got {steps}"
        )
    return [tuple(step if i == axis else 0.0 for i in range(4)) for axis in range(4) for step in steps]
