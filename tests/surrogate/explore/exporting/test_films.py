from __future__ import annotations

import builtins
import io
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from catalogs.vocabulary.cameras import Camera
from surrogate.explore.exporting.films import film_bytes
from surrogate.explore.exporting.sweep import Axis, Sweep, pictures, settings
from surrogate.explore.setting import Setting
from tests.support.models import following

CAMERA = Camera.look_at((3.0, 4.0, 1.0), (0, 0, 0), vertical_fov_degrees=31.0, width=120, height=96)
gif, mp4 = partial(film_bytes, "gif"), partial(film_bytes, "mp4")
BACKGROUND = (0.25, 0.5, 0.75)
SWEEP = Sweep(Setting({"p": 0.5}), Axis("p", 0.0, 1.0, 5))


def drawn(camera: Camera = CAMERA) -> list[NDArray[np.float32]]:
    """The API's image, without the sweep."""
    surrogate = following()
    return [s.member(surrogate).render(camera, background=BACKGROUND)[..., :3] for s in settings(SWEEP)]


def film(write: Any, camera: Camera = CAMERA, **options: Any) -> bytes:
    content: bytes = write(pictures(SWEEP, following(), camera, BACKGROUND), **options)
    return content


def gif_frames(content: bytes) -> list[NDArray[np.float64]]:
    image: Any = Image.open(io.BytesIO(content))
    frames = []
    for i in range(image.n_frames):
        image.seek(i)
        frames.append(np.asarray(image.convert("RGB")) / 255.0)
    return frames


def mp4_frames(content: bytes) -> list[NDArray[np.float64]]:
    """Decoded by PyAV, and made RGB by the formulas of Rec. 709 in limited range: FFmpeg's own are 2 / 255 too dark."""
    av = pytest.importorskip("av")
    with av.open(io.BytesIO(content)) as container:
        return [of_rec709(frame) for frame in container.decode(video=0)]


def of_rec709(frame: Any) -> NDArray[np.float64]:
    planes = [np.frombuffer(plane, np.uint8).reshape(plane.height, -1)[:, : plane.width] for plane in frame.planes]
    luma = (planes[0] - 16.0) / 219.0
    blue, red = ((plane.repeat(2, axis=0).repeat(2, axis=1) - 128.0) / 224.0 for plane in planes[1:])
    r, b = luma + 1.5748 * red, luma + 1.8556 * blue
    return np.stack([r, (luma - 0.2126 * r - 0.0722 * b) / 0.7152, b], axis=2).clip(0.0, 1.0)


# 256 colours are few for blobs of all hues; H.264 has half the resolution in colour.
READERS = [pytest.param(gif, gif_frames, 36.0, id="gif"), pytest.param(mp4, mp4_frames, 36.0, id="mp4")]


def decibels(one: NDArray[Any], other: NDArray[Any]) -> float:
    return float(-10.0 * np.log10(np.mean(np.square(one.astype(np.float64) - other))))


@pytest.mark.parametrize(("write", "read", "least"), READERS)
def test_frames_are_what_the_surrogate_draws(write: Any, read: Any, least: float) -> None:
    frames, expected = read(film(write)), drawn()
    assert len(frames) == len(expected)
    for i, (frame, picture) in enumerate(zip(frames, expected, strict=True)):
        assert frame.shape == picture.shape
        assert decibels(frame, picture) > least
        assert np.abs(frame[0, 0] - BACKGROUND).max() < 2.5 / 255
        assert np.abs(frame.mean(axis=(0, 1)) - picture.mean(axis=(0, 1))).max() < 1.5 / 255  # no shift of colours
        others = [decibels(frame, other) for k, other in enumerate(expected) if k != i]
        assert decibels(frame, picture) > max(others) + 3.0


@pytest.mark.parametrize(("write", "read", "least"), READERS)
def test_there_and_back_repeats_no_end(write: Any, read: Any, least: float) -> None:
    frames, expected = read(film(write, there_and_back=True)), drawn()
    assert len(frames) == 8
    for frame, i in zip(frames, (0, 1, 2, 3, 4, 3, 2, 1), strict=True):
        assert decibels(frame, expected[i]) > least - 1.0


def test_a_gif_never_ends_and_has_its_rate() -> None:
    image: Any = Image.open(io.BytesIO(film(gif, frames_per_second=20.0)))
    assert image.info["loop"] == 0
    assert image.info["duration"] == 50


def test_an_mp4_is_what_browsers_and_quicktime_play() -> None:
    av = pytest.importorskip("av")
    content = film(mp4, frames_per_second=7.5)
    assert content[4:8] == b"ftyp"
    with av.open(io.BytesIO(content)) as container:
        (track,) = container.streams
        assert (track.codec_context.name, track.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert track.codec_context.profile in ("High", "Main", "Baseline", "Constrained Baseline")
        assert track.average_rate == Fraction(15, 2)
        tags = (track.codec_context.colorspace, track.codec_context.color_primaries, track.codec_context.color_trc)
        assert [int(tag) for tag in tags] == [1, 1, 1]  # Rec. 709
        assert int(track.codec_context.color_range) == 1  # limited


def test_odd_sizes_become_even_in_mp4_alone() -> None:
    odd = CAMERA.resized(61, 47)
    expected = drawn(odd)
    for frame, picture in zip(mp4_frames(film(mp4, odd)), expected, strict=True):
        assert frame.shape == (48, 62, 3)
        assert decibels(frame[:47, :61], picture) > 30.0
        assert np.abs(frame[47] - frame[46]).mean() < 0.02
    assert gif_frames(film(gif, odd))[0].shape == (47, 61, 3)


@pytest.mark.parametrize("write", [gif, mp4])
@pytest.mark.parametrize(
    ("given", "options", "complaint"),
    [
        ([np.zeros((8, 8, 3), np.uint8)], {}, "two pictures or more, got 1"),
        ([], {}, "two pictures or more, got 0"),
        (
            [np.zeros((8, 8, 3), np.uint8), np.zeros((8, 9, 3), np.uint8)],
            {},
            r"of one size, got \(8, 8, 3\) and \(8, 9, 3\)",
        ),
        ([np.zeros((8, 8, 4), np.uint8)] * 2, {}, r"\[H, W, 3\]"),
        ([], {"frames_per_second": 0.0}, "0.5 to 50 pictures a second, got 0"),
        ([], {"frames_per_second": 60.0}, "0.5 to 50 pictures a second, got 60"),
    ],
)
def test_what_makes_no_film_is_named(write: Any, given: Any, options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        write(iter(given), **options)


def test_without_pyav_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *arguments: Any, **options: Any) -> Any:
        if name.split(".")[0] == "av":
            raise ModuleNotFoundError("No module named 'av'", name="av")
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ValueError, match=r"need PyAV: pip install 'gs-surrogate\[video\]', or make a GIF"):
        mp4(iter([np.zeros((8, 8, 3), np.uint8)] * 2))
