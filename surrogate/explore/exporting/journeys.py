"""Films from picture to picture, each of its own setting and camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from surrogate.answers.doubt import Doubt
from surrogate.explore.exporting.films import film_bytes
from surrogate.explore.exporting.marks import annotated, annotations_of
from surrogate.explore.request import FrameRequest, MessageError, frame_request
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting

LEAST, MOST = 2, 480  # frames of a journey
RATE = 24.0  # frames a second


@dataclass(frozen=True, eq=False)
class JourneyRequest:
    """Frames one after the other; each `FrameRequest` has one setting.  All have one size."""

    frames: tuple[FrameRequest, ...]
    form: Literal["gif", "mp4"]
    annotations: tuple[str, ...] = ()

    @property
    def setting(self) -> Setting:
        """The first."""
        return self.frames[0].settings[0]

    def content(self, run: Run, progress: Callable[..., Any], doubt: Doubt | None = None) -> bytes:
        """The film; `progress` is called with how many frames are drawn of how many, and with nothing before one is written."""
        return film_bytes(self.form, self._pictures(run, progress), frames_per_second=RATE, go_on=progress)

    def _pictures(self, run: Run, progress: Callable[..., Any]) -> Iterator[NDArray[np.float32]]:
        for number, frame in enumerate(self.frames):
            (setting,) = frame.settings
            picture = setting.member(run.surrogate).render(frame.camera, background=frame.background)[..., :3]
            parts = annotations_of(run, setting, self.annotations) if self.annotations else None
            yield picture if parts is None else annotated(picture, parts, frame.camera, frame.background)
            progress(number + 1, len(self.frames))


def journey_of(
    message: Mapping[str, Any], run: Run, form: Literal["gif", "mp4"], annotations: tuple[str, ...]
) -> JourneyRequest:
    """The request of a message whose `frames` are settings and cameras; raises MessageError for a wrong one."""
    frames = message["frames"]
    if not isinstance(frames, list) or not LEAST <= len(frames) <= MOST or not all(isinstance(f, dict) for f in frames):
        raise MessageError(f"frames must be a list of {LEAST} to {MOST} objects, each with a setting and a camera")
    shared = {"size": message.get("size"), "background": message.get("background", "#000000")}
    each = (
        frame_request(
            {**shared, "settings": [frame.get("setting")], "camera": frame.get("camera")}, run.surrogate, run.origins
        )
        for frame in frames
    )
    return JourneyRequest(tuple(each), form, annotations)
