"""What can be taken away from the explorer: pictures, films, Gaussians, code."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from surrogate.explore.exporting.films import gif, mp4
from surrogate.explore.exporting.pictures import encode, record_for
from surrogate.explore.exporting.ply import ply_bytes
from surrogate.explore.exporting.sheets import captioned, strip
from surrogate.explore.exporting.snippet import snippet
from surrogate.explore.exporting.sweep import Axis, Sweep, check, parameter, pictures
from surrogate.explore.request import FrameRequest, MessageError, frame_request, within
from surrogate.explore.run import Run

FILM_STEPS = 49  # frames of a film there, as many back

GoOn = Callable[..., Any]
Make = Callable[[FrameRequest, Mapping[str, Any], Run, GoOn], bytes]


@dataclass(frozen=True)
class Export:
    """A file to be saved."""

    name: str
    media_type: str
    content: bytes


def exported(message: Any, run: Run, go_on: GoOn = lambda *_: None) -> Export:
    """The file that a message asks for: that of a frame, with the `kind` of file and, for sheets and films, the `sweep`.

    `go_on` is called with every picture of a sheet or film that is drawn and written; what it raises ends the work.

    Raises MessageError for a wrong message, ValueError for what can't be made.
    """
    request = frame_request(message, run.surrogate)
    kind = message.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise MessageError(f"kind must be one of {', '.join(KINDS)}, got {str(kind)[:40]!r}")
    ending, media_type, make = KINDS[kind]
    content = make(request, message, run, go_on)
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", run.title).strip("-.") or "surrogate"
    return Export(f"{name}.{ending}", media_type, content)


def _picture(kind: str) -> Make:
    def make(request: FrameRequest, _: Mapping[str, Any], run: Run, __: GoOn) -> bytes:
        setting, camera, background = request.settings[0], request.camera, request.background
        drawn = setting.gaussians(run.surrogate).render(camera, background=background)[..., :3]
        return encode(drawn, kind, record=record_for(run.surrogate, setting, camera, background))  # type: ignore[arg-type]

    return make


def _gaussians(request: FrameRequest, _: Mapping[str, Any], run: Run, __: GoOn) -> bytes:
    return ply_bytes(request.settings[0].gaussians(run.surrogate))


def _code(request: FrameRequest, _: Mapping[str, Any], run: Run, __: GoOn) -> bytes:
    folder = run.model_folder or "surrogate"
    setting, camera, background = request.settings[0], request.camera, request.background
    return snippet(folder, setting, camera, background, surrogate=run.surrogate).encode()


def _sheet(request: FrameRequest, message: Mapping[str, Any], run: Run, go_on: GoOn) -> bytes:
    sweep = _sweep(request, message, run)
    drawn = pictures(sweep, run.surrogate, request.camera, request.background, progress=go_on)
    record = record_for(run.surrogate, sweep.base, request.camera, request.background)
    return strip(sweep, drawn, units=_units(sweep, run), background=request.background, record=record)


def _film(write: Callable[..., bytes]) -> Make:
    def make(request: FrameRequest, message: Mapping[str, Any], run: Run, go_on: GoOn) -> bytes:
        asked = _sweep(request, message, run)
        columns = Axis(asked.columns.name, asked.columns.low, asked.columns.high, FILM_STEPS)
        sweep = Sweep(asked.base, columns)
        drawn = pictures(sweep, run.surrogate, request.camera, request.background, progress=go_on)
        named = captioned(drawn, sweep, background=request.background, units=_units(sweep, run))
        return write(named, there_and_back=True, go_on=go_on)

    return make


def _units(sweep: Sweep, run: Run) -> dict[str, str]:
    axes = (sweep.columns, sweep.rows)
    return {axis.name: parameter(run.surrogate, axis.name).unit for axis in axes if axis is not None}


def _sweep(request: FrameRequest, message: Mapping[str, Any], run: Run) -> Sweep:
    """The sweep of a message: over the whole bounds of its parameters, the first also from a `low` to a `high`."""
    fields = message.get("sweep")
    if not isinstance(fields, Mapping):
        raise MessageError("a sheet or a film needs a sweep: choose a parameter in the tab Sweep")
    columns = _axis(fields, "name", "count", run)
    rows = _axis(fields, "second", "secondCount", run) if fields.get("second") else None
    of = parameter(run.surrogate, columns.name)
    low, high = (within(fields[n], of) if fields.get(n, "") != "" else getattr(of, n) for n in ("low", "high"))
    columns = replace(columns, low=low, high=high)
    sweep = Sweep(request.settings[0], columns, rows)
    check(sweep, run.surrogate)
    return sweep


def _axis(fields: Mapping[str, Any], name: str, count: str, run: Run) -> Axis:
    """An axis over the whole bounds of the parameter that `fields` name under `name`."""
    named, steps = fields.get(name), fields.get(count)
    if not isinstance(named, str) or isinstance(steps, bool) or not isinstance(steps, int):
        raise MessageError("a sweep has the name of a parameter and a number of pictures")
    of = parameter(run.surrogate, named)
    return Axis(named, of.low, of.high, steps)


KINDS: dict[str, tuple[str, str, Make]] = {
    "png": ("png", "image/png", _picture("png")),
    "exr": ("exr", "image/x-exr", _picture("exr")),
    "ply": ("ply", "application/octet-stream", _gaussians),
    "python": ("py", "text/x-python", _code),
    "sheet": ("png", "image/png", _sheet),
    "gif": ("gif", "image/gif", _film(gif)),
    "mp4": ("mp4", "video/mp4", _film(mp4)),
}
