"""Requests of exports from the options of `surrogate export` and `surrogate sweep`.

People give control points of transfer functions by their places; settings hold displacements.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.variations import APPEARANCE, POINT_PARAMETERS
from surrogate.command_line import assignment
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.cuts import cut_in, cut_of, record_of_cut
from surrogate.explore.exporting.annotations import PARTS, Point
from surrogate.explore.exporting.exports import (
    CommandRequest,
    ComparisonRequest,
    FieldsRequest,
    FilmRequest,
    GaussiansRequest,
    PageRequest,
    PictureRequest,
    SheetRequest,
)
from surrogate.explore.exporting.kinds import FILM_STEPS, GAUSSIAN_KINDS, ROW_STEPS, SHEET_STEPS, SITE
from surrogate.explore.exporting.sweep import Axis, Sweep, axis_of, parameters_of
from surrogate.explore.functions import function_of, record_of_function
from surrogate.explore.request import MOST_PINS, Color, places_of, setting_of
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting, base_function
from surrogate.storage.picture_records import record_of

MOST_SIDE = 8192  # pixels that a command may ask for
_State = tuple[Setting, Camera | None, Color | None, tuple[str, ...], tuple[Point, ...]]

STORED = "stored"  # what --compare takes beside parameters


def from_options(options: Mapping[str, Any], kind: Any, run: Run) -> CommandRequest:
    """The request of a command's options, for one of `KINDS`: `surrogate export`'s, or `surrogate sweep`'s for sheets and films.

    Simulation parameters that neither they nor the image to be `like` give are in the middle of their bounds.  Raises ValueError
    for wrong options.
    """
    surrogate = run.surrogate
    nothing: _State = (Setting({}), None, None, (), ())
    like, camera, like_background, parts, pins = _read_state(run, options["like"]) if options.get("like") else nothing
    if options.get("annotate"):
        parts = PARTS
        if kind in ("ply", "html", SITE, "vti"):
            raise ValueError(f"--annotate writes into pictures and films, not into .{kind} files")
    elif kind == "exr":
        parts = pins = ()
    function = _function_in(options["function"]) if options.get("function") else None
    cut = cut_in(options.get("clip", ""), options.get("slice", ""))
    if cut and (kind in GAUSSIAN_KINDS or kind in ("html", SITE, "vti")):
        raise ValueError(f"--clip and --slice cut pictures and films, not .{kind} files")
    setting = _setting(run, options["parameters"], options["color_map"], like, options["using"], function, cut)
    if kind in GAUSSIAN_KINDS:
        return GaussiansRequest(setting, kind, options["refit"])
    if kind in ("html", SITE):
        modes = options["field_modes"]
        if modes is not None and modes < 0:
            raise ValueError(f"--field-modes must be 0 or more, got {modes}")
        return PageRequest(setting, modes)
    if kind == "vti":
        names = options["appearance"] or [v for n, v in setting.visualization.items() if n == APPEARANCE]
        return FieldsRequest(setting, tuple(map(str, names)))
    camera = camera or _view(run, options["view"])
    if options["size"]:
        camera = camera.resized(*_pixels(options["size"], camera))
    background = _color(options["background"].split(",")) if options["background"] else None
    if options.get("compare"):
        other = None if options["compare"] == (STORED,) else _setting(run, options["compare"], "", setting)
        return ComparisonRequest(
            setting, camera, other, background or like_background or surrogate.background or WHITE, parts
        )
    if kind in ("png", "exr"):
        return PictureRequest(setting, camera, background or like_background or surrogate.background, kind, parts, pins)
    down, film = options["down"], kind in ("gif", "mp4")
    steps = options["steps"] or (FILM_STEPS if film else ROW_STEPS if down else SHEET_STEPS)
    columns = _axis(run, options["over"], steps, options["low"], options["high"])
    rows = _axis(run, down, options["rows_steps"], options["rows_from"], options["rows_to"]) if down else None
    request = Sweep(setting, columns, rows), camera, background or surrogate.background or WHITE
    if not film:
        return SheetRequest(*request, parts)
    return FilmRequest(*request, kind, options["fps"], options["there_and_back"], options["caption"], parts)


def extrapolations(request: CommandRequest, run: Run) -> list[str]:
    """Sentences that name values out of bounds, where the surrogate extrapolates."""
    if isinstance(request, SheetRequest | FilmRequest):
        setting, axes = request.sweep.base, request.sweep.axes
    else:
        setting, axes = request.setting, ()
    reached = {n: (value, value) for n, value in setting.values.items() if not isinstance(value, str)}
    reached |= {axis.name: (axis.low, axis.high) for axis in axes}
    sentences = []
    for name, of in parameters_of(run.surrogate).items():
        low, high = reached.get(name, (of.low, of.high))
        if low < of.low or high > of.high:
            first, last, least, most = (of.text(x + run.origins.get(name, 0.0)) for x in (low, high, of.low, of.high))
            far = first if low == high else f"{first} to {last}"
            sentences.append(
                f"{name} = {far} lies outside its bounds [{least}, {most}]: extrapolating beyond the training range"
            )
    return sentences


def _function(run: Run, record: Any) -> TransferFunction | None:
    base = base_function(run.surrogate)
    return None if record is None or base is None else function_of(record, base)


def _function_in(path: Path) -> Any:
    """The JSON value of a file that holds a transfer function."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} holds no transfer function in JSON: {error}") from None


def _read_state(run: Run, path: Path) -> _State:
    """The setting, camera, background and annotations that a picture keeps."""
    record = record_of(path)
    try:
        parameters = {name: float(value) for name, value in record["parameters"].items()}
        texts = str(record["color_map"]), str(record.get("using", ""))
        function = _function(run, record.get("function"))
        setting = Setting(parameters, dict(record["visualization"]), *texts, function, cut_of(record))
        camera = Camera.from_json(record["camera"]) if "camera" in record else None
        parts = tuple(part for part in PARTS if part in record.get("annotations", ()))
        pins = tuple(places_of(record.get("pins", []), "pins", MOST_PINS))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"the picture keeps no setting or camera that is understood: {error!r}") from error
    background = None if record.get("background") is None else _color(record["background"])
    return setting, camera, background, parts, pins


def _setting(
    run: Run,
    assignments: Sequence[str],
    color_map: str,
    like: Setting,
    using: str = "",
    function: Any = None,
    cut: Mapping[str, Any] | None = None,
) -> Setting:
    """The setting of assignments over `like` over the middle of all bounds, checked as a message of the page is."""
    space = run.surrogate.space
    names = [*space.names, *run.surrogate.visualization_names]
    texts = dict(_assignment(text, names) for text in assignments)
    strange = [name for name in texts if name not in names]
    if strange:
        raise ValueError(f"unknown parameter {', '.join(strange)}: this surrogate has {', '.join(names) or 'none'}")
    values = {name: _displacement(run, name, value) for name, value in texts.items()}
    varied = {name: value for name, value in values.items() if name not in space.names}
    middle = {p.name: p.middle for p in space.parameters}
    simulated = {name: value for name, value in values.items() if name in space.names}
    visualization = {} if function is not None and not varied else _merged(varied, like.visualization)
    if function is None and like.function is not None and not varied:
        function = record_of_function(like.function)
    record = {
        "parameters": {**middle, **like.parameters, **simulated},
        "visualization": visualization,
        "color_map": color_map or like.color_map,
        "using": using or like.using,
        "function": function,
        **record_of_cut(like.cut),
        **(cut or {}),
    }
    return setting_of(record, run.surrogate, run.origins)


def _merged(varied: Mapping[str, float | str], like: Mapping[str, float | str]) -> dict[str, float | str]:
    """Visualization parameters over others of their own variation; of another one they stand alone."""
    alike = set(varied) <= set(POINT_PARAMETERS) and set(like) <= set(POINT_PARAMETERS)
    return {**like, **varied} if alike or not varied else dict(varied)


def _displacement(run: Run, name: str, value: float | str) -> float | str:
    """The value as settings hold it; raises ValueError for a control point of a base that nobody knows."""
    if name not in POINT_PARAMETERS or name not in run.surrogate.visualization_names or isinstance(value, str):
        return value
    if not run.origins:
        raise ValueError(
            f"{name} can't be set without the catalog, which holds the transfer function that it belongs to"
        )
    return value - run.origins[name]


def _axis(run: Run, name: str, steps: int, *ends: float | None) -> Axis:
    return axis_of(run, name, steps, *(None if end is None else _displacement(run, name, end) for end in ends))


def _assignment(text: str, names: Sequence[str]) -> tuple[str, float | str]:
    """Name and value; one of `names` may hold a "=" or begin with a space."""
    name, value = assignment(text, names)
    try:
        return name, float(value)
    except ValueError:
        if value and name == APPEARANCE:  # no name of an appearance reads as a number
            return name, value
        raise ValueError(f"parameters are given as NAME=VALUE, got {text!r}") from None


def _view(run: Run, view: int) -> Camera:
    if not 0 <= view < len(run.cameras):
        raise ValueError(f"view must lie in 0..{len(run.cameras) - 1}, got {view}")
    return run.cameras[view]


def _color(parts: Any) -> Color:
    try:
        red, green, blue = (float(part) for part in parts)
    except (TypeError, ValueError):
        raise ValueError(f"a background is given as R,G,B, got {parts!r}") from None
    if not all(0.0 <= part <= 1.0 for part in (red, green, blue)):
        raise ValueError(f"a background lies in [0, 1], got {red:g},{green:g},{blue:g}")
    return red, green, blue


def _pixels(size: str, camera: Camera) -> tuple[int, int]:
    """Width and height of "640x480", of "512", or of "2x": twice those of the camera."""
    text = size.lower()
    width, _, height = text.partition("x")
    try:
        times = int(text[:-1]) if text.endswith("x") else 0
        sides = (times * camera.width, times * camera.height) if times else (int(width), int(height or width))
    except ValueError:
        raise ValueError(f"a size is given as WIDTHxHEIGHT, or as 2x, got {size!r}") from None
    if not all(1 <= side <= MOST_SIDE for side in sides):
        raise ValueError(f"a side has 1 to {MOST_SIDE} pixels, got {size}")
    return sides
