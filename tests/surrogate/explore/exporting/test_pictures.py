from __future__ import annotations

import io
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.typing import NDArray
from PIL import Image

from catalogs.files.images import premultiply, read_image, read_stored, to_bytes
from catalogs.vocabulary.cameras import Camera
from surrogate.explore.exporting import pictures as module
from surrogate.explore.exporting.pictures import encode, record_for
from surrogate.explore.setting import Setting
from surrogate.storage.picture_records import KEY, record_of
from tests.support.models import following

CAMERA = Camera.look_at((3.0, 4.0, 1.0), (0, 0, 0), vertical_fov_degrees=31.0, width=40, height=24)
SETTING = Setting({"p": 0.1 + 0.2}, {"c1_value": 0.1}, "viridis")
RECORD = {"name": 'Ω \n\\ "quoted"', "numbers": [0.1, 1e-300], "none": None}


def picture(background: tuple[float, float, float] | None = None) -> NDArray[np.float32]:
    return SETTING.member(following()).render(CAMERA, background=background)


def seen(content: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(content)))


def test_a_png_has_straight_alpha_that_another_decoder_sees() -> None:
    drawn = picture()
    pixels = seen(encode(drawn, "png"))
    assert 0.3 < drawn[..., 3].max() < 1.0
    np.testing.assert_array_equal(premultiply(pixels), np.minimum(to_bytes(drawn), to_bytes(drawn)[..., 3:]))
    np.testing.assert_array_equal(pixels[..., 3], to_bytes(drawn)[..., 3])


def test_three_channels_stay_three() -> None:
    drawn = picture((0.2, 0.3, 0.4))[..., :3]  # not contiguous
    for kind in ("png", "jpeg"):
        assert Image.open(io.BytesIO(encode(drawn, kind))).mode == "RGB"  # type: ignore[arg-type]
    np.testing.assert_array_equal(seen(encode(drawn, "png")), to_bytes(drawn))
    np.testing.assert_array_equal(seen(encode(to_bytes(drawn), "png")), to_bytes(drawn))


@pytest.mark.parametrize(("quality", "decibels"), [(50, 30.0), (85, 35.0), (95, 41.0)])
def test_a_jpeg_is_what_was_drawn(quality: int, decibels: float, monkeypatch: pytest.MonkeyPatch) -> None:
    assert module.JPEG_QUALITY == 85
    monkeypatch.setattr(module, "JPEG_QUALITY", quality)
    drawn = picture((0.2, 0.3, 0.4))[..., :3]
    error = seen(encode(drawn, "jpeg")) / 255.0 - drawn
    assert -10.0 * np.log10(np.mean(np.square(error))) > decibels


def test_an_exr_keeps_every_bit_and_premultiplied_alpha(tmp_path: Path) -> None:
    for drawn in (picture(), picture((1.0, 0.5, 0.0))[..., :3]):
        (tmp_path / "a.exr").write_bytes(encode(drawn, "exr"))
        np.testing.assert_array_equal(read_stored(tmp_path / "a.exr"), drawn)
    (tmp_path / "a.exr").write_bytes(encode(picture(), "exr"))
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr", dtype="float32"), picture())


@pytest.mark.parametrize("kind", ["png", "exr"])
def test_the_record_comes_back_from_bytes_and_files(tmp_path: Path, kind: Any) -> None:
    content = encode(picture(), kind, record=RECORD)
    (tmp_path / "a").write_bytes(content)
    assert record_of(content) == record_of(tmp_path / "a") == record_of(str(tmp_path / "a")) == RECORD


def test_other_readers_find_the_record_under_its_key(tmp_path: Path) -> None:
    texts = Image.open(io.BytesIO(encode(picture(), "png", record=RECORD))).text  # type: ignore[attr-defined]
    assert json.loads(texts[KEY]) == RECORD
    (tmp_path / "a.exr").write_bytes(encode(picture(), "exr", record=RECORD))
    assert json.loads(oiio.ImageBuf(str(tmp_path / "a.exr")).spec().getattribute(KEY)) == RECORD


def test_a_record_draws_the_picture_again() -> None:
    surrogate = following()
    content = encode(picture(), "exr", record=record_for(surrogate, SETTING, CAMERA, None))
    record = record_of(content)
    setting = Setting(record["parameters"], record["visualization"], record["color_map"])
    again = setting.member(surrogate).render(Camera.from_json(record["camera"]), background=record["background"])
    np.testing.assert_array_equal(again, picture())
    assert record["surrogate"] == "by hand"
    assert set(record["versions"]) == {"gs-surrogate", "torch", "numpy"}


def test_no_temporary_file_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    record_of(encode(picture(), "exr", record=RECORD))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("given", "options", "complaint"),
    [
        (np.zeros((4, 4), np.float32), {}, r"must be \[H, W, 3\] or \[H, W, 4\], got \(4, 4\)"),
        (np.zeros((4, 0, 3), np.float32), {}, r"got \(4, 0, 3\)"),
        (np.zeros((4, 4, 3), np.float64), {}, "float32 or uint8, got float64"),
        (np.full((4, 4, 3), np.nan, np.float32), {}, "must be finite"),
        (np.full((4, 4, 3), np.nan, np.float32), {"kind": "jpeg"}, "must be finite"),
        (np.full((4, 4, 3), np.inf, np.float32), {"kind": "exr"}, "must be finite"),
        (np.zeros((4, 4, 3), np.float32), {"kind": "webp"}, "one of jpeg, png, exr, got 'webp'"),
        (np.zeros((4, 4, 4), np.float32), {"kind": "jpeg"}, "JPEG has no alpha: render with a background"),
        (np.zeros((4, 4, 3), np.float32), {"kind": "jpeg", "record": {}}, "JPEG keeps no record"),
    ],
)
def test_what_can_not_be_encoded_is_named(given: NDArray[Any], options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        encode(given, **({"kind": "png"} | options))


def test_pictures_without_a_record_say_so(tmp_path: Path) -> None:
    for kind in ("png", "exr"):
        with pytest.raises(ValueError, match="these bytes keeps no record of how it was made"):
            record_of(encode(picture(), kind))  # type: ignore[arg-type]
    for content in (b"", b"GIF89a", encode(picture(), "png", record=RECORD)[:60], encode(picture(), "exr")[:40]):
        (tmp_path / "a.png").write_bytes(content)
        with pytest.raises(ValueError, match=r"no record can be read from .*a\.png"):
            record_of(tmp_path / "a.png")
    with pytest.raises(FileNotFoundError):
        record_of(tmp_path / "absent.png")
