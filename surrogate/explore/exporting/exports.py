"""Files that the explorer exports: a record for each kind, made from a message of the page or the options of a command.

In each record `setting` or `sweep` is what is shown, `camera` where from, and `background` the straight RGB in [0, 1] behind it.
`content` gives the bytes, the same whoever asked, and raises ValueError where the surrogate can't show what is asked for; `summary`
says in a line what they are.  The page's bounds are narrower than a command's, for strangers use them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from catalogs.cameras import Camera
from catalogs.variations import APPEARANCE
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.exporting.films import film_bytes
from surrogate.explore.exporting.kinds import FILM_STEPS, FRAMES_PER_SECOND, KINDS, ROW_STEPS, SHEET_STEPS
from surrogate.explore.exporting.pictures import encode, record_for, record_of
from surrogate.explore.exporting.ply import ply_bytes
from surrogate.explore.exporting.sheets import captioned, strip
from surrogate.explore.exporting.snippet import snippet
from surrogate.explore.exporting.sweep import Axis, Sweep, axis_over, parameter, parameters_of, pictures
from surrogate.explore.request import Color, MessageError, frame_request, within
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate

MOST_SIDE = 8192  # pixels that a command may ask for

Progress = Callable[..., Any]


@dataclass(frozen=True, eq=False)
class PictureRequest:
    """A picture that keeps how it was made; transparent without a background, else of three channels."""

    setting: Setting
    camera: Camera
    background: Color | None = None
    form: Literal["png", "exr"] = "png"

    def content(self, run: Run, progress: Progress) -> bytes:
        drawn = self.setting.gaussians(run.surrogate).render(self.camera, background=self.background)
        record = record_for(run.surrogate, self.setting, self.camera, self.background)
        return encode(drawn if self.background is None else drawn[..., :3], self.form, record=record)

    def summary(self, run: Run) -> str:
        return f"{self.camera.width}x{self.camera.height}, {self.setting}"


@dataclass(frozen=True, eq=False)
class GaussiansRequest:
    """The Gaussians as PLY, for other viewers."""

    setting: Setting

    def content(self, run: Run, progress: Progress) -> bytes:
        return ply_bytes(self.setting.gaussians(run.surrogate))

    def summary(self, run: Run) -> str:
        return f"{len(run.surrogate.gaussians):,} Gaussians, {self.setting}"


@dataclass(frozen=True, eq=False)
class CodeRequest:
    """The Python that draws a picture."""

    setting: Setting
    camera: Camera
    background: Color | None = None

    def content(self, run: Run, progress: Progress) -> bytes:
        folder = run.model_folder or "surrogate"
        return snippet(folder, run.surrogate, self.setting, self.camera, self.background).encode()


@dataclass(frozen=True, eq=False)
class SheetRequest:
    """The pictures of a sweep on one labelled PNG.  `progress` is called with how many are drawn, and of how many."""

    sweep: Sweep
    camera: Camera
    background: Color = WHITE

    def content(self, run: Run, progress: Progress) -> bytes:
        drawn = pictures(self.sweep, run.surrogate, self.camera, self.background, progress=progress)
        record = record_for(run.surrogate, self.sweep.base, self.camera, self.background)
        return strip(self.sweep, drawn, background=self.background, record=record)

    def summary(self, run: Run) -> str:
        return str(self.sweep)


@dataclass(frozen=True, eq=False)
class FilmRequest:
    """A sweep over one parameter as a film.  `progress` is called as for a sheet, and with nothing before a picture is written."""

    sweep: Sweep
    camera: Camera
    background: Color = WHITE
    form: Literal["gif", "mp4"] = "gif"
    frames_per_second: float = FRAMES_PER_SECOND
    there_and_back: bool = False
    caption: bool = True

    def __post_init__(self) -> None:
        if self.sweep.rows is not None:
            raise ValueError("a film goes over one parameter: leave the second out, or make a PNG")

    def content(self, run: Run, progress: Progress) -> bytes:
        drawn = pictures(self.sweep, run.surrogate, self.camera, self.background, progress=progress)
        return film_bytes(
            self.form,
            captioned(drawn, self.sweep, background=self.background) if self.caption else drawn,
            frames_per_second=self.frames_per_second,
            there_and_back=self.there_and_back,
            go_on=progress,
        )

    def summary(self, run: Run) -> str:
        return str(self.sweep)


@dataclass(frozen=True)
class Export:
    """A file to be saved."""

    name: str
    media_type: str
    content: bytes


CommandRequest = PictureRequest | GaussiansRequest | SheetRequest | FilmRequest
Request = CommandRequest | CodeRequest


def exported(message: Any, run: Run, go_on: Progress = lambda *_: None) -> Export:
    """The file that a message asks for, as in `from_message`; `go_on` is called as `progress`, and what it raises ends the work."""
    content = from_message(message, run.surrogate).content(run, go_on)
    ending, media_type = KINDS[message["kind"]]
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", run.title).strip("-.") or "surrogate"
    return Export(f"{name}.{ending}", media_type, content)


def from_message(message: Any, surrogate: Surrogate) -> Request:
    """The request of a message: that of a frame, with the `kind` of file and, for sheets and films, the `sweep`.

    A film goes over the first parameter, there and back, because it is watched again and again.  Raises MessageError for a wrong
    message, ValueError for what can't be made.
    """
    frame = frame_request(message, surrogate)
    shown, kind = (frame.settings[0], frame.camera, frame.background), message.get("kind")
    if kind not in tuple(KINDS):
        raise MessageError(f"kind must be one of {', '.join(KINDS)}, got {str(kind)[:40]!r}")
    if kind == "ply":
        return GaussiansRequest(frame.settings[0])
    if kind == "python":
        return CodeRequest(*shown)
    if kind in ("png", "exr"):
        return PictureRequest(*shown, kind)
    fields = message.get("sweep")
    if not isinstance(fields, Mapping):
        raise MessageError("a sheet or a film needs a sweep: choose a parameter in the tab Sweep")
    columns = _axis_in(fields, surrogate, "name", "count", "low", "high")
    if kind == "sheet":
        rows = _axis_in(fields, surrogate, "second", "secondCount") if fields.get("second") else None
        return SheetRequest(Sweep(shown[0], columns, rows), *shown[1:])
    film = Sweep(shown[0], replace(columns, count=FILM_STEPS))
    return FilmRequest(film, *shown[1:], kind, there_and_back=True)


def _axis_in(fields: Mapping[str, Any], surrogate: Surrogate, name: str, count: str, *ends: str) -> Axis:
    """An axis over the bounds of the parameter that `fields` name under `name`, or from one of the `ends` to the other."""
    named, steps = fields.get(name), fields.get(count)
    if not isinstance(named, str) or isinstance(steps, bool) or not isinstance(steps, int):
        raise MessageError("a sweep has the name of a parameter and a number of pictures")
    of = parameter(surrogate, named)
    return axis_over(of, steps, *(None if fields.get(end, "") == "" else within(fields[end], of) for end in ends))


def from_options(options: Mapping[str, Any], kind: Any, run: Run) -> CommandRequest:
    """The request of a command's options, for one of `KINDS`: `surrogate export`'s, or `surrogate sweep`'s for sheets and films.

    Simulation parameters that neither they nor the picture to be `like` tell stand in the middle of their bounds.  Raises
    ValueError for wrong options.
    """
    surrogate = run.surrogate
    like, camera, kept = _kept(options["like"]) if options.get("like") else (Setting({}), None, None)
    setting = _setting(surrogate, options, like)
    if kind == "ply":
        return GaussiansRequest(setting)
    camera = camera or _view(run, options["view"])
    if options["size"]:
        camera = camera.resized(*_pixels(options["size"]))
    background = _color(options["background"].split(",")) if options["background"] else None
    if kind in ("png", "exr"):
        return PictureRequest(setting, camera, background or kept or surrogate.background, kind)
    down, film = options["down"], kind in ("gif", "mp4")
    steps = options["steps"] or (FILM_STEPS if film else ROW_STEPS if down else SHEET_STEPS)
    columns = axis_over(parameter(surrogate, options["over"]), steps, options["low"], options["high"])
    bounds = options["rows_steps"], options["rows_from"], options["rows_to"]
    rows = axis_over(parameter(surrogate, down), *bounds) if down else None
    shown = Sweep(setting, columns, rows), camera, background or surrogate.background or WHITE
    if not film:
        return SheetRequest(*shown)
    return FilmRequest(*shown, kind, options["fps"], options["there_and_back"], options["caption"])


def guesses(request: CommandRequest, surrogate: Surrogate) -> list[str]:
    """Sentences naming what lies out of bounds, where a surrogate can only guess."""
    if isinstance(request, SheetRequest | FilmRequest):
        setting, axes = request.sweep.base, request.sweep.axes
    else:
        setting, axes = request.setting, ()
    reached = {n: (value, value) for n, value in setting.values.items() if not isinstance(value, str)}
    reached |= {axis.name: (axis.low, axis.high) for axis in axes}
    sentences = []
    for name, of in parameters_of(surrogate).items():
        low, high = reached.get(name, (of.low, of.high))
        if low < of.low or high > of.high:
            far = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            sentences.append(f"{name} = {far} lies outside its bounds [{of.low:g}, {of.high:g}]: a guess")
    return sentences


def _kept(path: Path) -> tuple[Setting, Camera | None, Color | None]:
    """The setting, camera and background that a picture keeps."""
    record = record_of(path)
    try:
        parameters = {name: float(value) for name, value in record["parameters"].items()}
        setting = Setting(parameters, dict(record["visualization"]), str(record["color_map"]))
        camera = Camera.from_json(record["camera"]) if "camera" in record else None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"the picture keeps no setting or camera that is understood: {error!r}") from error
    return setting, camera, None if record.get("background") is None else _color(record["background"])


def _setting(surrogate: Surrogate, options: Mapping[str, Any], like: Setting) -> Setting:
    """What the options ask for, over another setting, over the middle of all bounds."""
    values = dict(map(_assignment, options["parameters"]))
    shown = {name: value for name, value in values.items() if name not in surrogate.space.names}
    middle = {p.name: (p.low + p.high) / 2.0 for p in surrogate.space.parameters}
    simulated = {name: float(value) for name, value in values.items() if name not in shown}
    parameters = {**middle, **like.parameters, **simulated}
    return Setting(parameters, shown or like.visualization, options["color_map"] or like.color_map)


def _assignment(text: str) -> tuple[str, float | str]:
    name, _, value = (part.strip() for part in text.partition("="))
    try:
        return name, value if value and name == APPEARANCE else float(value)
    except ValueError:
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


def _pixels(size: str) -> tuple[int, int]:
    """Width and height of "640x480", or of "512"."""
    width, _, height = size.lower().partition("x")
    try:
        sides = int(width), int(height or width)
    except ValueError:
        raise ValueError(f"a size is given as WIDTHxHEIGHT, got {size!r}") from None
    if not all(1 <= side <= MOST_SIDE for side in sides):
        raise ValueError(f"a side has 1 to {MOST_SIDE} pixels, got {size}")
    return sides
