"""Names tell exports apart, are the same for the same, and harm nobody."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from catalogs.vocabulary.cameras import Camera
from surrogate.explore.exporting.exports import ComparisonRequest, FilmRequest, PictureRequest, SheetRequest
from surrogate.explore.exporting.naming import file_name
from surrogate.explore.exporting.sweep import Axis, Sweep
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from tests.support.models import following, plain

CAMERA = Camera.look_at((3.0, 4.0, 1.0), (0, 0, 0), vertical_fov_degrees=31.0, width=20, height=16)
MOVED = {"c1_value": 0.25, "c1_opacity": 0.0}


def picture(p: float = 0.3, **visualization: float) -> PictureRequest:
    return PictureRequest(Setting({"p": p}, visualization), CAMERA)


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (picture(), "blobs-p-0.3"),
        (picture(isovalue=0.45), "blobs-p-0.3-isovalue-0.45"),
        (picture(**MOVED), "blobs-p-0.3-c1_value-1.25"),  # its place; what stands where it was is left out
        (PictureRequest(Setting({"p": 0.3}, {}, "viridis"), CAMERA), "blobs-p-0.3-viridis"),
        (ComparisonRequest(Setting({"p": 0.3}), CAMERA, None), "blobs-compared-p-0.3"),
        (SheetRequest(Sweep(Setting({"p": 0.3}), Axis("p", 0.0, 1.0, 3)), CAMERA), "blobs-p-0-to-1"),
        (
            FilmRequest(Sweep(Setting({"p": 0.3}), Axis("c2_opacity", -0.2, 0.2, 3, origin=0.5)), CAMERA),
            "blobs-c2_opacity-0.3-to-0.7-p-0.3",
        ),
    ],
)
def test_a_name_says_what_is_shown(request_: object, words: str) -> None:
    run = Run("blobs", following())
    name = file_name(run, request_)
    assert re.fullmatch(rf"{re.escape(words)}-[0-9a-f]{{6}}", name)
    assert file_name(run, request_) == name


def test_different_exports_have_different_names() -> None:
    run, turned = Run("blobs", following()), CAMERA.resized(40, 32)
    requests = [
        picture(),
        picture(0.3000001),
        PictureRequest(Setting({"p": 0.3}), turned),
        ComparisonRequest(*_of(picture()), None),
    ]
    requests += [
        PictureRequest(*_of(picture()), background=(1.0, 0.0, 0.0)),
        PictureRequest(*_of(picture()), form="exr"),
    ]
    assert len({file_name(run, request) for request in requests}) == len(requests)


def _of(request: PictureRequest) -> tuple[Setting, Camera]:
    return request.setting, request.camera


@pytest.mark.parametrize("title", ['../a"\r\nX: y', "", "…", "a" * 500, ".hidden", "CON/../x\x00y"])
def test_names_are_short_and_safe(title: str, tmp_path: Path) -> None:
    name = file_name(Run(title, plain()), picture())
    assert re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,78}", name)
    (tmp_path / f"{name}.png").touch()
