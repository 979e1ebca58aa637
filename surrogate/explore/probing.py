"""The place that is seen at a pixel, and the emulated field there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import text
from native.ray_casting import Cut
from surrogate.emulation import EmulatedField
from surrogate.emulation.corners import Corners
from surrogate.emulation.validation import NORMAL
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate
from surrogate.model.emulated_member import EmulatedMember

Array = NDArray[np.float64]
MINUS = "\N{MINUS SIGN}"

NO_FIELD = "this run has no emulated field, so nobody knows values: `surrogate train` fits one where members keep coarse fields"
FAINT = 0.02  # opacity along a ray below which nothing is seen there
FINENESS = 4.0  # samples per smallest spacing
MOST_SAMPLES = 1 << 14  # along a ray


def field_member(surrogate: Surrogate, setting: Setting) -> EmulatedMember:
    """The emulated field of a setting as it is shown there, whole; raises ValueError for a surrogate without any."""
    field = surrogate.field
    if field is None:
        raise ValueError(NO_FIELD)
    if setting.is_free:
        return field.member(field.point(setting.parameters, "allow", setting.transfer_function(surrogate)))
    return field.member(field.point(setting.values, "allow"))


def seen_place(member: EmulatedMember, camera: Camera, pixel: Sequence[float]) -> Array | None:
    """The place (3,) in world units that is seen at `pixel` (right, down), counted from the picture's left top corner.

    In a volume half of the ray's opacity lies before it.  An isosurface is seen where the ray first meets it, a slice where the
    ray meets it, and of a cut what lies inside.  None where nothing is seen.
    """
    field = member.field()
    eye, direction = _ray(camera, pixel)
    enter, leave = _ends(member, eye, direction)
    if not leave > enter:
        return None
    if member.cut is not None and member.cut.plane is not None:
        place = eye + (enter + leave) / 2.0 * direction
        return None if np.isnan(_values(field, place[None])).any() else place
    count = min(math.ceil(FINENESS * (leave - enter) / min(field.spacing)) + 1, MOST_SAMPLES)
    ends = np.linspace(enter, leave, count + 1)
    if isinstance(member.appearance, Isosurface):
        values = _values(field, eye + ends[:, None] * direction) - member.appearance.isovalue
        at = _crossing(values, ends)
    else:
        values = _values(field, eye + ((ends[1:] + ends[:-1]) / 2.0)[:, None] * direction)
        transfer = member.appearance.transfer_function
        opacities = np.where(np.isnan(values), 0.0, transfer.opacities(values)).clip(0.0, 1.0 - 1e-12)
        depths = -np.log1p(-opacities) * (ends[1] - ends[0]) / transfer.opacity_unit_distance
        at = _half(np.concatenate([[0.0], -np.expm1(-np.cumsum(depths))]), ends)
    return None if at is None else np.asarray(eye + at * direction)


def values_at(field: EmulatedField, places: ArrayLike) -> list[dict[str, float] | None]:
    """The field's `value` at world places (N, 3), its standard `deviation`, and `half` the width of the 90 % interval.

    None for places outside the field and beside holes.
    """
    sampled = field.sample(np.reshape(places, (-1, 3)))
    assert sampled.deviations is not None
    return [
        None if math.isnan(value) else {"value": value, "deviation": deviation, "half": NORMAL * deviation}
        for value, deviation in zip(sampled.values.tolist(), sampled.deviations.tolist(), strict=True)
    ]


def value_words(number: Mapping[str, float] | None, unit: str) -> str:
    """A value of `values_at` to the second digit of its error, with that and the unit."""
    if number is None:
        return "no value"
    value, deviation, behind = number["value"], number["deviation"], f" {unit}" if unit else ""
    if not deviation > 0.0:
        return f"{value:.4g}".replace("-", MINUS) + behind
    places = max(0, min(12, 1 - math.floor(math.log10(deviation))))
    if abs(value) < 1e6 and places < 8:
        error = f"{deviation:.{places}f}" if places else text(float(f"{deviation:.2g}"))
        return f"{value:.{places}f} ± {error}".replace("-", MINUS) + behind
    words = f"{value:.3e} ± {deviation:.1e}".replace("e+0", "e+").replace("e-0", "e-")
    return words.replace("-", MINUS) + behind


def _ray(camera: Camera, pixel: Sequence[float]) -> tuple[Array, Array]:
    """The origin (3,) and the unit direction (3,) of the ray through a place of the picture."""
    right, down = pixel
    alone = replace(camera, cx=camera.cx - right + 0.5, cy=camera.cy - down + 0.5, width=1, height=1)
    eye, directions = alone.rays()
    return np.asarray(eye, np.float64).reshape(3), directions[0, 0]


def _ends(member: EmulatedMember, eye: Array, direction: Array) -> tuple[float, float]:
    """The distances from the eye at which a ray enters and leaves what is drawn of the field."""
    field = member.samples
    low, high = field.origin + (member.cut or Cut()).bounds(field) * field.spacing
    along = np.where(direction == 0.0, 1e-200, direction)
    ends = np.stack([(low - eye) / along, (high - eye) / along])
    return max(0.0, float(ends.min(0).max())), float(ends.max(0).min())


def _values(field: EmulatedField, places: Array) -> Array:
    """The field (N,) at places (N, 3); NaN in cells with a hole."""
    corners = Corners.of(places, field.values.shape, field.spacing, field.origin)
    values: Any = np.nan_to_num(corners.weights) * field.values.ravel()[corners.indices]  # places outside: rounding
    sums = values.sum(1)
    if field.holes is not None:
        sums[field.holes.ravel()[corners.indices].any(1)] = np.nan
    return np.asarray(np.where(np.isnan(corners.weights).any(1), np.nan, sums))


def _half(opacities: Array, ends: Array) -> float | None:
    """The end, between others, at which half of the last of growing opacities is reached; None where that is faint."""
    if opacities[-1] < FAINT:
        return None
    return float(np.interp(opacities[-1] / 2.0, opacities, ends))


def _crossing(values: Array, ends: Array) -> float | None:
    """The first place where values, NaN in holes, change their sign."""
    with np.errstate(invalid="ignore"):
        crossed = np.flatnonzero(values[:-1] * values[1:] <= 0.0)
    if not len(crossed):
        return None
    i = int(crossed[0])
    apart = values[i + 1] - values[i]
    return float(ends[i] + (ends[i + 1] - ends[i]) * (0.0 if apart == 0.0 else -values[i] / apart))
