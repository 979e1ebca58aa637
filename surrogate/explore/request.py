"""Requests of a browser: types, lengths, ranges and sizes of every message are checked before anything is drawn."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter
from catalogs.vocabulary.variations import APPEARANCE, POINT_PARAMETERS
from catalogs.vocabulary.words import joined_names
from native.ray_casting import Cut
from surrogate.explore.color_maps import NAMES as COLOR_MAPS
from surrogate.explore.cuts import cut_of
from surrogate.explore.functions import function_of
from surrogate.explore.setting import Setting, base_function
from surrogate.model import Surrogate
from surrogate.model.places import beyond_limits

Made = TypeVar("Made")
Color = tuple[float, float, float]

MOST_SETTINGS = 64
MOST_PINS = 20
LEAST_SIDE, MOST_SIDE = 8, 2048
MOST_PIXELS = 4 * 1024 * 1024  # of all pictures of one frame together
LEAST_FIELD, MOST_FIELD = 1.0, 150.0  # vertical field of view, degrees
FARTHEST = 1e6  # how far cameras may stand away, in half sizes of the volume


class MessageError(ValueError):
    """A message is wrong; the browser shows this one sentence."""


@dataclass(frozen=True, eq=False)
class FrameRequest:
    """Pictures of one or more settings from one camera."""

    settings: tuple[Setting, ...]  # one picture each
    camera: Camera  # its size is that of each picture
    background: Color  # straight RGB in [0, 1] that the pictures stand on
    form: Literal["jpeg", "png"]  # "jpeg" while something moves, "png" at rest
    difference: bool = False  # whether the absolute difference of the first two pictures follows them
    truth: bool = False  # whether the catalog's picture of the first setting, if any, and the difference to it follow


def frame_request(message: Any, surrogate: Surrogate, origins: Mapping[str, float] | None = None) -> FrameRequest:
    """Check a message and return its request; raises MessageError for a wrong one, as `setting_of` does."""
    fields = _mapping(message, "the message")
    records = _sequence(fields.get("settings"), "settings", 1, MOST_SETTINGS)
    settings = tuple(setting_of(record, surrogate, origins) for record in records)
    camera = camera_of(fields.get("camera"), fields.get("size"), surrogate)
    if camera.width * camera.height * len(settings) > MOST_PIXELS:
        raise MessageError(
            f"{len(settings)} pictures of {camera.width}x{camera.height} are more than {MOST_PIXELS:,} pixels: ask for smaller ones"
        )
    form: Any = fields.get("form", "jpeg")
    _require(form in ("jpeg", "png"), "form must be jpeg or png", form)
    difference, truth = (fields.get(name, False) for name in ("difference", "truth"))
    _require(isinstance(difference, bool), "difference must be true or false", difference)
    _require(isinstance(truth, bool), "truth must be true or false", truth)
    _require(not difference or len(settings) == 2, "a difference is between two settings", len(settings))
    _require(not truth or len(settings) == 1, "the truth stands beside one setting", len(settings))
    return FrameRequest(settings, camera, color_of(fields.get("background", "#000000")), form, difference, truth)


def setting_of(record: Any, surrogate: Surrogate, origins: Mapping[str, float] | None = None) -> Setting:
    """A setting of the surrogate: all simulation parameters, the visualization parameters of one variation or none.

    Raises MessageError for others; with the `origins` of a `Run` it tells control points by their places.
    """
    fields, names = _mapping(record, "a setting"), surrogate.space.names
    parameters = _mapping(fields.get("parameters"), "parameters")
    _require(set(parameters) == set(names), f"parameters must be exactly {joined_names(names)}", sorted(parameters))
    color_map = fields.get("color_map", "")
    is_known = isinstance(color_map, str) and color_map in ("", *COLOR_MAPS)
    _require(is_known, f"color_map must be one of {', '.join(COLOR_MAPS)} or empty", color_map)
    visualization = _visualization(_mapping(fields.get("visualization", {}), "visualization"), surrogate, origins or {})
    using, offered = fields.get("using", ""), ("", *surrogate.representations)
    _require(
        isinstance(using, str) and using in offered, f"using must be one of {', '.join(offered[1:])} or empty", using
    )
    function = None if fields.get("function") is None else _function(fields["function"], visualization, surrogate)
    own = {p.name: within(parameters[p.name], p) for p in surrogate.space.parameters}
    setting = Setting(own, visualization, color_map, using, function, _cut(fields))
    if setting.cut is not None:
        _checked(lambda: setting.whole(surrogate))
    follows_functions = set(visualization) <= set(POINT_PARAMETERS)
    if color_map and not follows_functions:
        raise MessageError("a colour map belongs to a transfer function, not to isosurfaces or other appearances")
    if color_map or (visualization and follows_functions and base_function(surrogate) is not None):
        _checked(lambda: setting.transfer_function(surrogate))  # control points may cross, or colours be fixed
    return setting


def _function(record: Any, visualization: Mapping[str, Any], surrogate: Surrogate) -> TransferFunction:
    base = base_function(surrogate)
    if base is None:
        raise MessageError("this surrogate follows no transfer functions, so it can't be shown under another one")
    _require(not visualization, "a transfer function stands alone, without visualization", sorted(visualization))
    return _checked(lambda: function_of(record, base))


def _cut(fields: Mapping[str, Any]) -> Cut | None:
    return _checked(lambda: cut_of(fields))


def _checked(make: Callable[[], Made]) -> Made:
    """All that `make` makes, its ValueError as a MessageError."""
    try:
        return make()
    except ValueError as error:
        raise MessageError(_shortened_sentence(str(error))) from None


def _visualization(
    values: Mapping[str, Any], surrogate: Surrogate, origins: Mapping[str, float]
) -> dict[str, float | str]:
    variations = surrogate.variations
    variation = next((v for v in variations if set(values) <= set(v.argument_names)), None)
    if not values:
        return {}
    if variation is None:
        names = [list(v.argument_names) for v in variations]
        raise MessageError(
            f"visualization must be of one of {names or 'no'} parameters, got {_shortened_text(sorted(values))}"
        )
    if variation.continuous:
        parameters = (p for p in variation.space.parameters if p.name in values)
        return {p.name: within(values[p.name], p, origins.get(p.name, 0.0)) for p in parameters}
    appearances = [variation.base, *variation.parameter_names]
    _require(
        values[APPEARANCE] in appearances, f"{APPEARANCE} must be one of {', '.join(appearances)}", values[APPEARANCE]
    )
    return {APPEARANCE: str(values[APPEARANCE])}


def camera_of(record: Any, size: Any, surrogate: Surrogate) -> Camera:
    """A camera from `position`, `target`, `up` (3,) in world units and `field` in degrees, of `size` (width, height)."""
    fields = _mapping(record, "camera")
    width, height = (_side(side) for side in _sequence(size, "size", 2, 2))
    field = _number(fields.get("field"), "camera.field")
    fits = LEAST_FIELD <= field <= MOST_FIELD
    _require(fits, f"camera.field must lie in {LEAST_FIELD:g} to {MOST_FIELD:g} degrees", field)
    position, target, up = (_point(fields.get(name), f"camera.{name}") for name in ("position", "target", "up"))
    center, extent = surrogate.normalization.center, surrogate.normalization.extent
    for name, point in (("position", position), ("target", target)):
        far = max(abs(x - c) for x, c in zip(point, center.tolist(), strict=True)) / extent
        if far > FARTHEST:
            raise MessageError(f"camera.{name} is {far:.3g} half sizes of the volume away: at most {FARTHEST:g}")
    _require(1e-6 < math.hypot(*up) < 1e6, "camera.up must have a length of about 1", math.hypot(*up))
    try:
        return Camera.look_at(position, target, vertical_fov_degrees=field, width=width, height=height, up=up)
    except ValueError as error:
        raise MessageError(f"not a camera: {error}") from None


def color_of(value: Any) -> Color:
    """Straight RGB in [0, 1] of "#rrggbb"."""
    proper = isinstance(value, str) and re.fullmatch(r"#[0-9a-fA-F]{6}", value) is not None
    _require(proper, "a colour is written #rrggbb", value)
    red, green, blue = (int(value[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


def within(value: Any, parameter: Parameter, origin: float = 0.0) -> float:
    """The value as a number within `surrogate.model.places.limits`; raises MessageError for anything else."""
    number = _number(value, parameter.name)
    if sentence := beyond_limits(parameter, number, origin):
        raise MessageError(sentence)
    return number


def _mapping(value: Any, name: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise MessageError(f"{name} must be an object of named values, got {_shortened_text(value)}")
    return value


def _sequence(value: Any, name: str, least: int, most: int) -> Sequence[Any]:
    if not isinstance(value, list | tuple) or not least <= len(value) <= most:
        count = f"{least} to {most}" if least < most else str(least)
        raise MessageError(f"{name} must be a list of {count}, got {_shortened_text(value)}")
    return value


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MessageError(f"{name} must be a number, got {_shortened_text(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise MessageError(f"{name} must be finite, got {_shortened_text(value)}")
    return number


def _point(value: Any, name: str) -> tuple[float, float, float]:
    x, y, z = point_of(value, name, 3)
    return x, y, z


def point_of(value: Any, name: str, count: int) -> tuple[float, ...]:
    """That number of finite numbers; raises MessageError for anything else."""
    return tuple(_number(part, name) for part in _sequence(value, name, count, count))


def places_of(value: Any, name: str, most: int) -> list[tuple[float, ...]]:
    """At most that number of points, each three finite numbers; raises MessageError for anything else."""
    return [point_of(part, name, 3) for part in _sequence(value, name, 0, most)]


def _side(value: Any) -> int:
    number = _number(value, "size")
    fits = number.is_integer() and LEAST_SIDE <= number <= MOST_SIDE
    _require(fits, f"a side of a picture has {LEAST_SIDE} to {MOST_SIDE} pixels", number)
    return int(number)


def _require(met: bool, demand: str, value: Any) -> None:
    """Raise MessageError that names the demand and the value, unless it is met."""
    if not met:
        raise MessageError(f"{demand}, got {_shortened_text(value)}")


def _shortened_sentence(text: str) -> str:
    return text if len(text) <= 300 else f"{text[:297]}..."


def _shortened_text(value: Any) -> str:
    """A value from outside, shortened for an error."""
    if isinstance(value, str | bytes | list | tuple | dict) and len(value) > 200:
        return f"{type(value).__name__} of {len(value)}"
    try:
        text = repr(value)
    except RecursionError:
        text = f"a {type(value).__name__} of nested values"
    return text if len(text) <= 80 else f"{text[:77]}..."
