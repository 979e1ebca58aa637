"""Transfer functions: the base's, with its two inner control points displaced."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Appearance, TransferFunction, VolumeRendering, field_of
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations.variation import Family, Variation, VariationSetting, appearance_named

POINT_PARAMETERS = ("c1_value", "c1_opacity", "c2_value", "c2_opacity")
SINGLE_STEPS = (-1.0, 0.5, 1.0)  # steps by which one coordinate of one control point is moved alone


class TransferFunctionVariation(Variation):
    """Displacements of the base's inner control points: values in the field's unit, opacities per `opacity_unit_distance`."""

    kind = "transfer_function"
    name = "transfer function"
    plural = "transfer functions"
    edits_base = True
    parameter_names = POINT_PARAMETERS
    field_values = ("c1_value", "c2_value")

    def normalize(self, values: Sequence[float] | None) -> NDArray[np.float64]:
        """Displacements (4,) in units of their largest; of the base for None, which is zero."""
        return self.space.normalize((0.0,) * len(self.space) if values is None else values)

    def mismatches(self, appearances: Sequence[Appearance]) -> list[str]:
        by_name = {appearance.name: appearance for appearance in appearances}
        base = by_name[self.base]
        if _four_points(base) is None:
            return [f"the base {self.base} is not a volume rendering with four opacity points"]
        fields = {setting.appearance: field_of(by_name[setting.appearance]) for setting in self.settings}
        return super().mismatches(appearances) + [
            f"{name} shows the field {field!r}, its base {field_of(base)!r}"
            for name, field in fields.items()
            if field != field_of(base)
        ]

    @classmethod
    def family(cls, base: VolumeRendering, scene_appearances: Sequence[str], **table: Any) -> Family:
        return transfer_function_family(base, **table)

    def appearance_at(self, values: Sequence[float] | None, appearances: Sequence[Appearance]) -> Appearance:
        base = appearance_named(self.base, appearances)
        if values is None or not isinstance(base, VolumeRendering):
            return base
        return replace(base, transfer_function=displaced(base.transfer_function, values))

    def _shows(self, appearance: Appearance, values: tuple[float, ...], base: Appearance) -> bool:
        function = _four_points(base)
        try:
            return function is not None and _four_points(appearance) == displaced(function, values)
        except ValueError:
            return False


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
    """The 76 training transfer functions around `base`, and others for validation and test, drawn from the same box by `seed`.

    As in GS-Surrogate's transfer-function editing, 64 functions displace both inner control points, each by one of the 8 non-zero
    displacements {-, 0, +}².  The other 12 displace one coordinate of one point by each of three steps.

    Parameters
    ----------
    base : an opacity function of four control points: fixed ends of opacity 0 and 1, and c1, c2 between them.
    first_step, second_step : (value, opacity) by which c1 and c2 are displaced.
    single_steps : the three steps of the single displacements, as multiples.

    Raises ValueError naming the function where a displaced point would cross its neighbours or leave [0, 1].

    Examples
    --------
    >>> from insitu import TransferFunction, VolumeRendering, transfer_function_family
    >>> points = ((0.0, 0.0), (0.3, 0.2), (0.7, 0.6), (1.0, 1.0))
    >>> base = VolumeRendering("base", TransferFunction(((0, 0, 0, 1), (1, 1, 0, 0)), points, opacity_unit_distance=0.1))
    >>> family = transfer_function_family(base, first_step=(0.1, 0.1), second_step=(0.1, 0.2), validation=4, test=4)
    >>> len(family.appearances)  # 76 to train, 4 to validate, 4 to test
    84
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
    random = np.random.default_rng(seed)
    rows = {"train": np.array(_training_displacements(single_steps))}  # [76, 4]
    for split, count in (("validation", validation), ("test", test)):
        rows[split] = random.uniform(-1.0, 1.0, (count, 4))
    decimals = [max(9, 6 - math.floor(math.log10(step))) for step in steps.tolist()]  # more only for small units
    settings, appearances = [], []
    for split, displacements in rows.items():
        for i, moved in enumerate((displacements * steps).tolist(), start=1):
            displacement = tuple(map(round, moved, decimals))
            name = f"{base.name}-{split}-{i:02d}"
            settings.append(VariationSetting(name, displacement, split))
            appearances.append(_displaced_appearance(base, name, displacement))
    units = (unit, "", unit, "")
    parameters = (
        Parameter(n, -step, step, u) for n, step, u in zip(POINT_PARAMETERS, steps.tolist(), units, strict=True)
    )
    variation = TransferFunctionVariation(base.name, ParameterSpace(tuple(parameters)), tuple(settings))
    return Family(variation, tuple(appearances))


def displaced(base: TransferFunction, displacement: Sequence[float]) -> TransferFunction:
    """`base` with its inner control points moved by (4,) `POINT_PARAMETERS`; raises ValueError where they cross or leave [0, 1]."""
    low, (first, opacity), (second, other), high = base.opacity_points
    moved = (first + displacement[0], opacity + displacement[1]), (second + displacement[2], other + displacement[3])
    return replace(base, opacity_points=(low, *moved, high))


def origins_of(base: TransferFunction | None) -> dict[str, float]:
    """Values and opacities of the base's inner control points by `POINT_PARAMETERS`; nothing without a base."""
    if base is None or len(base.opacity_points) != 4:
        return {}
    return dict(zip(POINT_PARAMETERS, [part for point in base.opacity_points[1:3] for part in point], strict=True))


def _four_points(appearance: Appearance) -> TransferFunction | None:
    """The transfer function, if it has four opacity points."""
    if not isinstance(appearance, VolumeRendering) or len(appearance.transfer_function.opacity_points) != 4:
        return None
    return appearance.transfer_function


def _displaced_appearance(base: VolumeRendering, name: str, displacement: Sequence[float]) -> VolumeRendering:
    try:
        return replace(base, name=name, transfer_function=displaced(base.transfer_function, displacement))
    except ValueError as error:
        displacements = dict(zip(POINT_PARAMETERS, displacement, strict=True))
        raise ValueError(
            f"{name} moves the control points of {base.name} by {displacements} too far: {error}; take smaller steps, or a base "
            "whose points lie farther from each other and from 0 and 1"
        ) from None


def _training_displacements(single_steps: Sequence[float]) -> list[tuple[float, ...]]:
    """The 76 displacements (4,) in units of the steps: first the joint ones, then the single ones."""
    valid = len(single_steps) == len(set(single_steps)) == 3 and 0.0 not in single_steps
    if not valid or not all(-1.0 <= step <= 1.0 for step in single_steps):
        raise ValueError(
            "single_steps must be three different multiples of the steps, in [-1, 1] and none of them zero, got "
            f"{single_steps}"
        )
    signs = [pair for pair in itertools.product((-1.0, 0.0, 1.0), repeat=2) if any(pair)]
    joint = [(*first, *second) for first in signs for second in signs]
    return joint + [tuple(step if i == axis else 0.0 for i in range(4)) for axis in range(4) for step in single_steps]
