"""Families of appearances: one base, varied by visualization parameters that an explorer may set freely afterwards.

An isovalue varies over a family of isosurfaces beside the base volume rendering.  A transfer function varies by the displacement
of its two inner control points from those of the base.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.parameters import SPLITS, Parameter, ParameterSpace

Kind = Literal["isovalue", "transfer_function"]
KINDS: tuple[Kind, ...] = ("isovalue", "transfer_function")
POINT_PARAMETERS = ("c1_value", "c1_opacity", "c2_value", "c2_opacity")
ISOVALUE = "isovalue"
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


@dataclass(frozen=True)
class Variation:
    """Visualization parameters, P_vis, and the appearances that sample them.

    Attributes
    ----------
    kind : "isovalue" or "transfer_function".
    base : name of the appearance that is varied.
    space : the visualization parameters; of a transfer function the displacements of its inner control points,
        `POINT_PARAMETERS`, zero at the base: values in the field's unit, opacities per `opacity_unit_distance`.
    settings : the appearances beside the base.
    """

    kind: Kind
    base: str
    space: ParameterSpace
    settings: tuple[Setting, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "settings", tuple(self.settings))
        if self.kind not in KINDS:
            raise ValueError(f"the kind of a variation must be one of {KINDS}, got {self.kind!r}")
        expected = (ISOVALUE,) if self.kind == "isovalue" else POINT_PARAMETERS
        if self.space.names != expected:
            raise ValueError(f"a variation of kind {self.kind} has the parameters {expected}, got {self.space.names}")
        if not any(s.split == "train" for s in self.settings):
            raise ValueError(f"the variation of {self.base} has no training settings")
        if any(len(s.values) != len(self.space) for s in self.settings):
            raise ValueError(f"every setting of {self.base} must have {len(self.space)} values")

    def setting(self, appearance: str) -> Setting | None:
        """The setting with this appearance, None for others."""
        return next((s for s in self.settings if s.appearance == appearance), None)

    def normalize(self, values: Sequence[float] | None) -> NDArray[np.float64]:
        """Visualization parameters (V,) as a network sees them, about -1 to 1; of the base for None.

        Isovalues are mapped so that the trained ones lie at equal distances, as they were chosen to (linearly between and
        beyond them); the base, which has none, is NaN.  Displacements are in units of their largest; the base is zero.
        """
        if self.kind == "transfer_function":
            return self.space.normalize(np.zeros(len(self.space)) if values is None else values)
        if values is None:
            return np.full(1, np.nan)
        trained = np.array(sorted(s.values[0] for s in self.settings if s.split == "train"))  # [T]
        even = np.linspace(-1.0, 1.0, len(trained))
        slopes = np.diff(even) / np.diff(trained)  # [T - 1]
        below = min(values[0] - trained[0], 0.0) * slopes[0]
        above = max(values[0] - trained[-1], 0.0) * slopes[-1]
        return np.array([np.interp(values[0], trained, even) + below + above])

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
    if len(set(train)) < 2 or len(set(values)) != len(values):
        raise ValueError(f"isovalues must differ, and at least two be trained, got {values}")
    low, high = float(min(train)), float(max(train))
    if not all(low <= value <= high for value in values):
        raise ValueError(f"every isovalue must lie within the trained ones, {low:g} to {high:g}, got {values}")
    settings = tuple(Setting(f"iso={value:g}", (value,), split) for split, value in rows)
    surfaces = tuple(Isosurface(s.appearance, s.values[0], **(style or {})) for s in settings)
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

    Raises ValueError where a displaced point would leave its place between its neighbours, or [0, 1].
    """
    points = base.transfer_function.opacity_points
    if len(points) != 4 or (points[0][1], points[3][1]) != (0.0, 1.0):
        raise ValueError(
            f"appearance {base.name}: a transfer function to be varied has four opacity points, the ends of opacity "
            f"0 and 1, got {points}"
        )
    steps = np.array([*first_step, *second_step], dtype=np.float64)  # [4]
    if steps.shape != (4,) or not (steps > 0).all():
        raise ValueError(f"first_step and second_step must be a positive (value, opacity) each, got {steps.tolist()}")
    trained = [*_joint_displacements(), *_single_displacements(single_steps)]
    random = np.random.default_rng(seed)
    rows = {"train": np.array(trained)}
    rows |= {
        split: random.uniform(-1.0, 1.0, (count, 4)) for split, count in (("validation", validation), ("test", test))
    }
    settings, shown = [], []
    for split, displacements in rows.items():
        for i, displacement in enumerate((displacements * steps).round(9).tolist(), start=1):
            name = f"{base.name}-{split}-{i:02d}"
            settings.append(Setting(name, tuple(displacement), split))
            shown.append(replace(base, name=name, transfer_function=displaced(base.transfer_function, displacement)))
    space = ParameterSpace(
        tuple(
            Parameter(name, -step, step, unit if name.endswith("value") else "")
            for name, step in zip(POINT_PARAMETERS, steps.tolist(), strict=True)
        )
    )
    return Family(Variation("transfer_function", base.name, space, tuple(settings)), tuple(shown))


def displaced(base: TransferFunction, displacement: Sequence[float]) -> TransferFunction:
    """`base` with its inner control points moved by (4,) `POINT_PARAMETERS`; raises ValueError where that is none any more."""
    ends, (first, second) = (base.opacity_points[0], base.opacity_points[3]), base.opacity_points[1:3]
    moved_first = (first[0] + displacement[0], first[1] + displacement[1])
    moved_second = (second[0] + displacement[2], second[1] + displacement[3])
    return replace(base, opacity_points=(ends[0], moved_first, moved_second, ends[1]))


def _joint_displacements() -> list[tuple[float, ...]]:
    signs = [pair for pair in itertools.product((-1.0, 0.0, 1.0), repeat=2) if pair != (0.0, 0.0)]
    return [(*first, *second) for first in signs for second in signs]


def _single_displacements(steps: Sequence[float]) -> list[tuple[float, ...]]:
    if len(steps) != 3 or 0.0 in steps or len(set(steps)) != 3:
        raise ValueError(f"single_steps must be three different multiples, none of them zero, got {steps}")
    return [tuple(step if i == axis else 0.0 for i in range(4)) for axis in range(4) for step in steps]
