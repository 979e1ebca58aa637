"""The two alpha conventions meet without loss, and a damaged file is named."""

from __future__ import annotations

import errno
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image  # an independent decoder

from catalogs.files.images import (
    ImageError,
    encode_png,
    exr_text,
    premultiply,
    read_image,
    read_stored,
    straighten,
    to_bytes,
    to_float,
    write_exr,
    write_image,
)
from catalogs.files.png import PngError, check_png, text_of


def every_pixel() -> np.ndarray:
    """All 32,896 valid 8-bit pairs of premultiplied colour and alpha, as an image."""
    pairs = [(c, a) for a in range(256) for c in range(a + 1)]
    pixels = np.array([(c, c, c, a) for c, a in pairs], dtype=np.uint8)
    return np.concatenate([pixels, np.zeros((257 * 129 - len(pixels), 4), np.uint8)]).reshape(257, 129, 4)


def test_the_eight_bit_round_trip_is_exact_for_every_valid_pixel(tmp_path: Path) -> None:
    pixels = every_pixel()
    assert np.array_equal(premultiply(straighten(pixels)), pixels)
    write_image(tmp_path / "all.png", pixels)
    assert np.array_equal(read_image(tmp_path / "all.png"), pixels)


@given(arrays.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([3, 4]))))
def test_another_decoder_reads_what_is_encoded(pixels: np.ndarray) -> None:
    seen = Image.open(io.BytesIO(encode_png(pixels)))
    assert seen.mode == ("RGB" if pixels.shape[2] == 3 else "RGBA")
    assert np.array_equal(np.asarray(seen), pixels)


@given(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"])))
def test_another_decoder_reads_the_texts_of_a_png(text: str) -> None:
    content = encode_png(np.zeros((2, 3, 3), np.uint8), {"first": "one", "kept here": text})
    assert Image.open(io.BytesIO(content)).text == {"first": "one", "kept here": text}  # type: ignore[attr-defined]
    assert text_of(content, "kept here") == text
    assert text_of(content, "kept") is None


@pytest.mark.parametrize(("keyword", "text"), [("", "a"), ("k" * 80, "a"), ("λ", "a"), ("k", "a\0b")])
def test_texts_that_a_png_cannot_keep_are_refused(keyword: str, text: str) -> None:
    with pytest.raises(ValueError, match="1 to 79 Latin-1 characters and no zeros"):
        encode_png(np.zeros((2, 3, 3), np.uint8), {keyword: text})


def test_texts_of_damaged_files_are_not_believed() -> None:
    content = encode_png(np.zeros((2, 3, 3), np.uint8), {"key": "text"})
    with pytest.raises(PngError, match="checksum"):
        text_of(content.replace(b"text", b"test"), "key")
    with pytest.raises(PngError, match="not a PNG"):
        text_of(b"GIF89a", "key")


@pytest.mark.parametrize("channels", [3, 4])
def test_an_exr_keeps_texts_and_every_bit(tmp_path: Path, channels: int) -> None:
    pixels = np.random.default_rng(2).random((5, 7, channels), dtype=np.float32)
    write_exr(tmp_path / "a.exr", pixels, {"some-key": '{"Ω": 0.3}'})
    assert exr_text(tmp_path / "a.exr", "some-key") == '{"Ω": 0.3}'
    assert exr_text(tmp_path / "a.exr", "other") is None
    assert np.array_equal(read_stored(tmp_path / "a.exr"), pixels)
    assert b"capDate" not in (tmp_path / "a.exr").read_bytes(), "the time of writing makes equal pictures differ"


def test_encoded_pictures_are_whole_and_small(tmp_path: Path) -> None:
    y, x = np.mgrid[0:256, 0:256] / 256.0
    alpha = np.clip(1.2 - 3.0 * np.hypot(x - 0.5, y - 0.5), 0.0, 1.0)
    color = [alpha * (0.5 + 0.5 * np.sin(9 * x + i) * np.cos(7 * y * i)) for i in (1, 2, 3)]
    smooth = to_bytes(np.stack([*color, alpha], axis=-1).astype(np.float32))
    write_image(tmp_path / "a.png", smooth)
    header = check_png(tmp_path / "a.png")
    assert (header.width, header.height, header.kind) == (256, 256, "8-bit RGBA")
    Image.fromarray(straighten(smooth)).save(tmp_path / "other.png", compress_level=1)
    assert (tmp_path / "a.png").stat().st_size < 1.1 * (tmp_path / "other.png").stat().st_size


def test_both_conversions_are_those_of_whole_numbers_for_all_pairs_of_bytes() -> None:
    """65,536 pairs, also invalid ones, in each channel; halves are rounded up."""
    alpha, color = np.mgrid[0:256, 0:256]
    pixels = np.stack([color, np.roll(color, 7, axis=1), color[:, ::-1], alpha], axis=-1).astype(np.uint8)
    wide, a = pixels[..., :3].astype(np.int64), alpha[..., None]
    straight = (2 * 255 * np.minimum(wide, a) + a) // np.maximum(2 * a, 1)
    assert np.array_equal(straighten(pixels), np.concatenate([straight, a], axis=-1))
    assert np.array_equal(premultiply(pixels), np.concatenate([(wide * a + 127) // 255, a], axis=-1))


def test_any_shape_of_pixels_is_converted() -> None:
    pixels = every_pixel()
    batch = np.stack([pixels, pixels[::-1]])[:, ::2, 1:]  # not contiguous
    wanted = straighten(np.ascontiguousarray(batch))
    assert np.array_equal(straighten(batch), wanted)
    assert np.array_equal(premultiply(wanted), batch)
    assert straighten(pixels[5, 100]).shape == (4,)
    assert straighten(pixels[:0]).shape == (0, 129, 4)


def test_another_decoder_sees_straight_alpha(tmp_path: Path) -> None:
    pixels = every_pixel()
    write_image(tmp_path / "all.png", pixels)
    seen = np.asarray(Image.open(tmp_path / "all.png").convert("RGBA")).astype(np.float64)
    alpha, wanted = pixels[..., 3:].astype(np.float64), pixels[..., :3].astype(np.float64)
    assert np.array_equal(seen[..., 3:], alpha)
    assert np.abs(seen[..., :3] * alpha / 255.0 - wanted).max() < 0.5
    for background in (0.0, 255.0):  # what a browser shows
        shown = seen[..., :3] * alpha / 255.0 + (1.0 - alpha / 255.0) * background
        assert np.abs(shown - (wanted + (255.0 - alpha) / 255.0 * background)).max() <= 1.0


def test_color_above_alpha_is_cut_to_alpha() -> None:
    pixels = np.array([[[200, 10, 0, 100]]], dtype=np.uint8)
    assert premultiply(straighten(pixels)).tolist() == [[[100, 10, 0, 100]]]


def test_float_images_keep_every_bit(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).random((7, 5, 4)).astype(np.float32)
    write_image(tmp_path / "a.exr", pixels)
    assert np.array_equal(read_image(tmp_path / "a.exr", dtype="float32"), pixels)


def test_float_and_bytes_convert_both_ways() -> None:
    pixels = every_pixel()
    assert np.array_equal(to_bytes(to_float(pixels)), pixels)


@pytest.mark.parametrize(("mode", "channels"), [("L", 1), ("LA", 2), ("RGB", 3)])
def test_files_with_fewer_channels_become_rgba(tmp_path: Path, mode: str, channels: int) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (6, 9, channels), dtype=np.uint8)
    Image.fromarray(pixels.squeeze(), mode).save(tmp_path / "a.png")
    seen = read_image(tmp_path / "a.png")
    assert seen.shape == (6, 9, 4)
    wanted = np.asarray(Image.open(tmp_path / "a.png").convert("RGBA"))
    assert np.array_equal(seen, premultiply(wanted))


def test_every_damaged_byte_is_told_or_harmless(tmp_path: Path) -> None:
    path = tmp_path / "flipped.png"
    pixels = every_pixel()[100:112, 40:60]
    write_image(path, pixels)
    data = path.read_bytes()
    told = 0
    for place in range(len(data)):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x20]) + data[place + 1 :])
        try:
            assert np.array_equal(read_image(path), pixels), f"byte {place}"
        except ImageError:
            told += 1
    assert told > 0.9 * len(data)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no disk that is always full")
@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_a_full_disk_is_noticed(tmp_path: Path, name: str) -> None:
    (tmp_path / name).symlink_to("/dev/full")
    with pytest.raises(OSError, match=rf"{name}") as caught:
        write_image(tmp_path / name, every_pixel())
    assert name.endswith("exr") or caught.value.errno == errno.ENOSPC


def test_what_is_stored_is_seen_as_it_is(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (6, 9, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "A.PNG")
    assert np.array_equal(read_stored(tmp_path / "A.PNG"), pixels)


@pytest.mark.parametrize("keep", [0, 7, 40, 0.5, 0.95])
def test_a_truncated_file_is_named(tmp_path: Path, keep: float) -> None:
    path = tmp_path / "cut.png"
    write_image(path, np.random.default_rng(0).integers(0, 100, (40, 40, 4), dtype=np.uint8) // 2)
    data = path.read_bytes()
    path.write_bytes(data[: int(keep if keep >= 1 else keep * len(data))])
    with pytest.raises(ImageError, match=r"cut\.png"):
        read_image(path)


@pytest.mark.parametrize(
    "bad",
    [
        np.zeros((4, 4, 3), np.uint8),
        np.zeros((4, 4), np.uint8),
        np.zeros((0, 4, 4), np.uint8),
        np.zeros((4, 4, 4), np.float64),
        np.full((4, 4, 4), np.nan, np.float32),
    ],
)
def test_what_is_no_image_is_refused(tmp_path: Path, bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match="must be"):
        write_image(tmp_path / "a.png", bad)
    assert not (tmp_path / "a.png").exists()
