"""Films through settings and cameras; wrong frames are refused before anything is drawn."""

from __future__ import annotations

import io
import itertools
from typing import Any

import numpy as np
import pytest
from PIL import Image

from surrogate.explore.exporting.exports import from_message
from surrogate.explore.exporting.journeys import MOST
from surrogate.explore.request import MessageError
from surrogate.explore.run import Run
from tests.support.models import following
from tests.support.requests import message


@pytest.fixture(scope="module")
def run() -> Run:
    return Run("blobs", following())


def frame(p: float, x: float = 3.0) -> dict[str, Any]:
    asked = message()
    return {
        "setting": asked["settings"][0] | {"parameters": {"p": p}},
        "camera": asked["camera"] | {"position": [x, 1.0, 0.5]},
    }


def test_each_frame_has_its_own_setting_and_camera(run: Run) -> None:
    frames, counts = [frame(0.2), frame(0.4, 3.5), frame(0.9, 4.0)], []
    request = from_message(message(kind="gif", frames=frames, size=[64, 48]), run)
    content = request.content(run, lambda *count: counts.append(count))
    with Image.open(io.BytesIO(content)) as film:
        assert (film.n_frames, film.size) == (3, (64, 48))
        pictures = []
        for number in range(3):
            film.seek(number)
            pictures.append(np.asarray(film.convert("RGB"), dtype=float))
    assert all(np.abs(a - b).max() > 10 for a, b in itertools.pairwise(pictures))
    assert [count for count in counts if count] == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize(
    ("frames", "complaint"),
    [
        ([], "2 to 480 objects"),
        ([frame(0.2)], "2 to 480 objects"),
        ([frame(0.2)] * (MOST + 1), "2 to 480 objects"),
        ("x", "2 to 480 objects"),
        ([frame(0.2), 3], "2 to 480 objects"),
        ([frame(0.2), {}], "a setting must be an object"),
        ([frame(0.2), {"setting": frame(0.2)["setting"]}], "camera must be an object"),
        ([frame(0.2), frame(99.0)], "p"),
    ],
)
def test_wrong_frames_are_refused(run: Run, frames: Any, complaint: str) -> None:
    with pytest.raises(MessageError, match=complaint):
        from_message(message(kind="gif", frames=frames), run)
