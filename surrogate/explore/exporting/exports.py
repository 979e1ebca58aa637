"""Files that the explorer exports: a record for each kind, made from a message of the page or the options of a command.

In each record `setting` or `sweep` is what is shown, `camera` where from, and `background` the straight RGB in [0, 1] behind it.
`content` gives the bytes, the same whoever asked, and raises ValueError where the surrogate can't show what is asked for; with an
`doubt` pictures say what error to expect.  `summary` says in a line what they are.  The page's sizes are smaller than a
command's, for strangers use them; the bounds of parameters are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import joined_names
from surrogate.answers.doubt import Doubt, Interval
from surrogate.emulation.exports import vti_bytes
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.explore.exporting.annotations import PARTS, Point
from surrogate.explore.exporting.comparison import comparison
from surrogate.explore.exporting.expectations import Expectations
from surrogate.explore.exporting.films import film_bytes
from surrogate.explore.exporting.glb import glb_bytes
from surrogate.explore.exporting.journeys import JourneyRequest, journey_of
from surrogate.explore.exporting.kinds import FILM_STEPS, FRAMES_PER_SECOND, GAUSSIAN_KINDS, KINDS, REFIT_STEPS
from surrogate.explore.exporting.marks import all_annotated, annotated, annotations_of
from surrogate.explore.exporting.naming import file_name
from surrogate.explore.exporting.page import page_bytes, page_contents, page_files
from surrogate.explore.exporting.pictures import encode, record_for
from surrogate.explore.exporting.ply import ply_bytes
from surrogate.explore.exporting.refit import refitted
from surrogate.explore.exporting.sheets import captioned, strip
from surrogate.explore.exporting.snippet import snippet
from surrogate.explore.exporting.splats import Splats
from surrogate.explore.exporting.spz import spz_bytes
from surrogate.explore.exporting.sweep import Axis, Sweep, axis_of, pictures, settings
from surrogate.explore.request import MOST_PINS, Color, MessageError, frame_request, places_of
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting, listed
from surrogate.explore.truth import Truth
from surrogate.model import DeformedGaussians
from surrogate.model.deformed import NO_FIELD
from surrogate.model.representation import GAUSSIANS

Progress = Callable[..., Any]


@dataclass(frozen=True, eq=False)
class PictureRequest:
    """A picture that keeps how it was made; transparent without a background, else of three channels."""

    setting: Setting
    camera: Camera
    background: Color | None = None
    form: Literal["png", "exr"] = "png"
    annotations: tuple[str, ...] = ()
    pins: tuple[Point, ...] = ()  # world places, with the field's values

    def __post_init__(self) -> None:
        if (self.annotations or self.pins) and self.form == "exr":
            raise ValueError("an EXR keeps the picture alone, without annotations: make a PNG")

    def content(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> bytes:
        image = self.setting.member(run.surrogate).render(self.camera, background=self.background)
        expected = self.expected(run, doubt)
        record = record_for(run.surrogate, self.setting, self.camera, self.background, expected)
        if self.annotations or self.pins:
            record["annotations"] = list(self.annotations)
            if self.pins:
                record["pins"] = [list(pin) for pin in self.pins]
            said = annotations_of(run, self.setting, self.annotations, self.pins)
            image = annotated(image, said, self.camera, self.background)
        return encode(image if self.background is None else image[..., :3], self.form, record=record)

    def expected(self, run: Run, doubt: Doubt | None) -> Interval | None:
        return None if doubt is None else self.setting.doubted(doubt).interval(self.camera)

    def summary(self, run: Run) -> str:
        return f"{self.camera.width}x{self.camera.height}, {self.setting.described(run.origins)}"


@dataclass(frozen=True, eq=False)
class GaussiansRequest:
    """The Gaussians for other viewers, fitted to our pictures by their rule in `refit` steps; 0 leaves them as they are."""

    setting: Setting
    form: Literal["ply", "glb", "spz"] = "ply"
    refit: int = 0

    def content(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> bytes:
        if GAUSSIANS not in run.surrogate.representations:
            raise ValueError(
                f"a .{self.form} holds Gaussians, and this surrogate has none: `surrogate train RUN` trains them"
            )
        if self.setting.cut is not None:
            raise ValueError(f"a .{self.form} holds whole Gaussians: reset the clip box and the slice")
        gaussians = replace(self.setting, using=GAUSSIANS).member(run.surrogate)
        assert isinstance(gaussians, DeformedGaussians)
        splats = Splats.of(gaussians)
        if self.refit > 0:
            member, placed = self.setting.member(run.surrogate), gaussians.normalization

            def fitted(done: int, total: int) -> None:
                progress(done, total, "steps")

            splats = refitted(splats, member.render, run.cameras, placed, self.refit, fitted)
        return {"ply": ply_bytes, "glb": glb_bytes, "spz": spz_bytes}[self.form](splats)

    def summary(self, run: Run) -> str:
        fitted = ", fitted for other viewers" if self.refit > 0 else ""
        return f"{len(run.surrogate.gaussians):,} Gaussians{fitted}, {self.setting.described(run.origins)}"


@dataclass(frozen=True, eq=False)
class PageRequest:
    """The explorer, drawn by the browser; see `page_bytes` and `page_files`, which also know the number of `modes`."""

    setting: Setting
    modes: int | None = None

    def content(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> bytes:
        return page_bytes(run, self._expected(run, progress, doubt), self.modes)

    def files(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> dict[str, bytes]:
        """The same as files by their paths in a folder."""
        return page_files(run, self._expected(run, progress, doubt), self.modes)

    def _expected(self, run: Run, progress: Progress, doubt: Doubt | None) -> Expectations:
        def measured(stage: str, done: int, total: int) -> None:
            progress(done, total)

        return Expectations.of(run, doubt, measured)

    def summary(self, run: Run) -> str:
        return f"a page of {page_contents(run, self.modes)}, which opens in a browser without a program"


@dataclass(frozen=True, eq=False)
class FieldsRequest:
    """Emulated fields with their standard deviations as VTK image data: all, or those `named`, see `FieldModel.fields`."""

    setting: Setting
    named: tuple[str, ...] = ()

    def content(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> bytes:
        if run.surrogate.field is None:
            raise ValueError(NO_FIELD)
        return vti_bytes(run.surrogate.field.fields(self.setting.parameters, self.named))

    def summary(self, run: Run) -> str:
        labels = [] if run.surrogate.field is None else run.surrogate.field.labels(self.named)
        return f"{joined_names(labels)} with standard deviations, {listed(self.setting.parameters)}"


@dataclass(frozen=True, eq=False)
class CodeRequest:
    """The Python that draws a picture."""

    setting: Setting
    camera: Camera
    background: Color | None = None

    def content(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> bytes:
        folder = run.model_folder or "surrogate"
        return snippet(folder, run.surrogate, self.setting, self.camera, self.background).encode()


@dataclass(frozen=True, eq=False)
class ComparisonRequest:
    """A setting beside another one, or beside the catalog's picture of it where `other` is None, and their difference."""

    setting: Setting
    camera: Camera
    other: Setting | None
    background: Color = WHITE
    annotations: tuple[str, ...] = ()

    def content(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> bytes:
        first = self._render(self.setting, run)
        words = [self._words("A", self.setting, run, doubt)]
        if self.other is None:
            second, words_of_second = self._stored_image(run)
            words = [["prediction", *words[0][1:]], words_of_second]
        else:
            second = self._render(self.other, run)
            words.append(self._words("B", self.other, run, doubt))
        record = record_for(run.surrogate, self.setting, self.camera, self.background)
        if self.other is not None:
            record["other"] = record_for(run.surrogate, self.other, self.camera, self.background)
        return comparison(first, second, words, over=self._over(run), background=self.background, record=record)

    def summary(self, run: Run) -> str:
        other = "its stored picture" if self.other is None else self.other.described(run.origins)
        return f"{self.setting.described(run.origins)} beside {other}"

    def _over(self, run: Run) -> Callable[[NDArray[np.float32], int], NDArray[np.float32]]:
        """A function that draws the box, and what is cut, over picture 0 or 1, once the difference is known."""
        parts = [part for part in self.annotations if part == "box"]
        said = [annotations_of(run, setting, parts) for setting in (self.setting, self.other or self.setting)]
        return lambda image, i: annotated(image, said[i], self.camera, self.background) if parts else image

    def _render(self, setting: Setting, run: Run) -> NDArray[np.float32]:
        return setting.member(run.surrogate).render(self.camera, background=self.background)[..., :3]

    def _words(self, name: str, setting: Setting, run: Run, doubt: Doubt | None) -> list[str]:
        expected = doubt and setting.doubted(doubt).interval(self.camera)
        return [f"{name}: {setting.described(run.origins)}", *([expected.short] if expected else [])]

    def _stored_image(self, run: Run) -> tuple[NDArray[np.float32], list[str]]:
        truth = Truth.of(run)
        match = None if truth is None else truth.match(self.setting, self.camera)
        if truth is None or match is None:
            raise ValueError(
                "the catalog has no picture of this: choose the parameters and the view of one of its members"
            )
        if (match.camera.width, match.camera.height) != (self.camera.width, self.camera.height):
            raise ValueError(
                f"the stored picture has {match.camera.width}x{match.camera.height} pixels: compare at this size"
            )
        return composite(truth.picture(match), self.background), ["stored picture", match.sentence]


@dataclass(frozen=True, eq=False)
class SheetRequest:
    """The pictures of a sweep on one labelled PNG.  `progress` is called with how many are drawn, and of how many."""

    sweep: Sweep
    camera: Camera
    background: Color = WHITE
    annotations: tuple[str, ...] = ()

    def content(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> bytes:
        images = pictures(self.sweep, run.surrogate, self.camera, self.background, progress=progress)
        parts = [part for part in self.annotations if part in ("box", "axes")]  # the sheet says the rest
        images = all_annotated(images, run, settings(self.sweep), parts, self.camera, self.background)
        record = record_for(run.surrogate, self.sweep.base, self.camera, self.background)
        return strip(self.sweep, images, background=self.background, record=record)

    def summary(self, run: Run) -> str:
        return self.sweep.described(run.origins)


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
    annotations: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.sweep.rows is not None:
            raise ValueError("a film goes over one parameter: leave the second out, or make a PNG")

    def content(self, run: Run, progress: Progress, doubt: Doubt | None = None) -> bytes:
        images = pictures(self.sweep, run.surrogate, self.camera, self.background, progress=progress)
        parts = self.annotations
        images = all_annotated(images, run, settings(self.sweep), parts, self.camera, self.background)
        return film_bytes(
            self.form,
            captioned(images, self.sweep, background=self.background) if self.caption else images,
            frames_per_second=self.frames_per_second,
            there_and_back=self.there_and_back,
            go_on=progress,
        )

    def summary(self, run: Run) -> str:
        return self.sweep.described(run.origins)


@dataclass(frozen=True)
class Export:
    """A file to be saved."""

    name: str
    media_type: str
    content: bytes


CommandRequest = (
    PictureRequest | PageRequest | GaussiansRequest | FieldsRequest | ComparisonRequest | SheetRequest | FilmRequest
)
Request = CommandRequest | CodeRequest | JourneyRequest


def exported(message: Any, run: Run, go_on: Progress = lambda *_: None, doubt: Doubt | None = None) -> Export:
    """The file that a message asks for, as in `from_message`; `go_on` is called as `progress`, and what it raises ends the work."""
    request = from_message(message, run)
    content = request.content(run, go_on, doubt)
    ending, media_type = KINDS[message["kind"]]
    return Export(f"{file_name(run, request)}.{ending}", media_type, content)


def from_message(message: Any, run: Run) -> Request:
    """The request of a message: that of a frame, with the `kind` of file and, for sheets and films, the `sweep`.

    A comparison is of the two settings, or with `truth` of one and its stored picture.  A sweep's ends are displacements for
    control points, as in a setting.  A film goes through `frames`, see `journey_of`, or over the first parameter, there and back,
    because it is watched again and again.  Raises MessageError for a wrong message, ValueError for what can't be made.
    """
    frame = frame_request(message, run.surrogate, run.origins)
    arguments, kind = (frame.settings[0], frame.camera, frame.background), message.get("kind")
    if kind not in tuple(KINDS):
        raise MessageError(f"kind must be one of {', '.join(KINDS)}, got {str(kind)[:40]!r}")
    if kind in GAUSSIAN_KINDS:
        return GaussiansRequest(frame.settings[0], kind, _refit(message.get("refit", 0)))
    if kind == "html":
        return PageRequest(frame.settings[0])
    if kind == "vti":
        return FieldsRequest(frame.settings[0])
    if kind == "python":
        return CodeRequest(*arguments)
    parts = _annotations(message.get("annotations"))
    if kind in ("png", "exr"):
        return PictureRequest(*arguments, kind, *((parts, _pins(message)) if kind == "png" else ()))
    if kind == "comparison":
        if len(frame.settings) != 2 and not frame.truth:
            raise MessageError("a comparison is of two settings, or of one and its stored picture")
        return ComparisonRequest(*arguments[:2], None if frame.truth else frame.settings[1], frame.background, parts)
    if kind in ("gif", "mp4") and message.get("frames") is not None:
        return journey_of(message, run, kind, parts)
    fields = message.get("sweep")
    if not isinstance(fields, Mapping):
        raise MessageError("a sheet or a film needs a sweep: choose a parameter in the tab Sweep")
    columns = _axis_in(fields, run, "name", "count", "low", "high")
    if kind == "sheet":
        down = ("second", "secondCount", "secondLow", "secondHigh")
        rows = _axis_in(fields, run, *down) if fields.get("second") else None
        return SheetRequest(Sweep(arguments[0], columns, rows), *arguments[1:], parts)
    film = Sweep(arguments[0], replace(columns, count=FILM_STEPS))
    return FilmRequest(film, *arguments[1:], kind, there_and_back=True, annotations=parts)


def _refit(steps: Any) -> int:
    """Steps by which Gaussians are fitted, as a message asks for them."""
    if isinstance(steps, bool) or not isinstance(steps, int) or not 0 <= steps <= REFIT_STEPS:
        raise MessageError(f"refit is a whole number of steps, 0 to {REFIT_STEPS}, got {str(steps)[:40]}")
    return steps


def _annotations(record: Any) -> tuple[str, ...]:
    """The parts of annotations that a message asks for; none without a record of them."""
    if record is None:
        return ()
    parts = record.get("shown") if isinstance(record, Mapping) else None
    if not isinstance(parts, list) or not all(part in PARTS for part in parts):
        raise MessageError(f"annotations have shown, a list of {', '.join(PARTS)}")
    return tuple(part for part in PARTS if part in parts)


def _pins(message: Mapping[str, Any]) -> tuple[Point, ...]:
    pins = (message.get("annotations") or {}).get("pins", [])
    places = [pin.get("place") if isinstance(pin, Mapping) else pin for pin in pins] if isinstance(pins, list) else pins
    return tuple(places_of(places, "pins", MOST_PINS))


def _axis_in(fields: Mapping[str, Any], run: Run, name: str, count: str, *ends: str) -> Axis:
    """An axis over the bounds of the parameter that `fields` name under `name`, or from one of the `ends` to the other."""
    named, steps = fields.get(name), fields.get(count)
    if not isinstance(named, str) or isinstance(steps, bool) or not isinstance(steps, int):
        raise MessageError("a sweep has the name of a parameter and a number of pictures")
    return axis_of(run, named, steps, *(None if fields.get(end, "") == "" else fields[end] for end in ends))
