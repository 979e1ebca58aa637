"""zlib-ng and the standard library write the same pictures, read each other's, and report the same damage."""

from __future__ import annotations

import io
import runpy
import sys
import zlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image
from zlib_ng import zlib_ng

from catalogs.files import deflate
from catalogs.files.images import encode_png, read_image, write_image
from catalogs.files.packed import PackError, open_pack, write_pack
from catalogs.files.png import PngError, check_png

IMPLEMENTATIONS = {"zlib-ng": zlib_ng, "zlib": zlib}


def use(implementation: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("compressobj", "crc32", "decompressobj"):
        monkeypatch.setattr(deflate, name, getattr(implementation, name))
    monkeypatch.setattr(deflate, "DeflateError", implementation.error)


@pytest.fixture(params=list(IMPLEMENTATIONS))
def either(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    use(IMPLEMENTATIONS[request.param], monkeypatch)
    return request.param


def pictures() -> dict[str, np.ndarray]:
    """Straight RGBA and RGB: smooth, noisy, empty, in runs, tiny, and longer than several blocks of a deflated stream."""
    random = np.random.default_rng(4)
    y, x = np.mgrid[0:200, 0:300] / 200.0
    smooth = np.stack([x, y, x * y, np.exp(-9 * (x - 0.7) ** 2 - 9 * (y - 0.5) ** 2)], axis=-1)
    noise = random.integers(0, 256, (400, 500, 4), dtype=np.uint8)
    return {
        "smooth": (128 * smooth).astype(np.uint8),
        "grainy": (120 * smooth).astype(np.uint8) + random.integers(0, 5, smooth.shape, dtype=np.uint8),
        "noise": noise,
        "half noise": np.concatenate([noise, np.zeros_like(noise)]),
        "empty": np.zeros((300, 300, 4), np.uint8),
        "runs": np.repeat(noise[:40, :40, :3], 33, axis=1),
        "one": noise[:1, :1],
        **{f"{width} wide": noise[:3, :width, :3] >> 5 for width in range(1, 40)},
    }


def test_zlib_ng_is_taken_where_it_is_installed_else_the_standard_library(monkeypatch: pytest.MonkeyPatch) -> None:
    path = str(deflate.__file__)
    assert runpy.run_path(path)["compressobj"] is zlib_ng.compressobj
    monkeypatch.setitem(sys.modules, "zlib_ng", None)
    alone = runpy.run_path(path)
    assert (alone["compressobj"], alone["DeflateError"]) == (zlib.compressobj, zlib.error)


def test_pictures_have_the_same_bytes_by_both(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded = {}
    for name, implementation in IMPLEMENTATIONS.items():
        use(implementation, monkeypatch)
        encoded[name] = {key: encode_png(pixels) for key, pixels in pictures().items()}
    assert encoded["zlib-ng"] == encoded["zlib"]


def test_other_decoders_read_what_either_writes(either: str) -> None:
    for key, pixels in pictures().items():
        assert np.array_equal(np.asarray(Image.open(io.BytesIO(encode_png(pixels)))), pixels), key


def test_either_reads_a_pack_and_reports_its_damage(either: str, tmp_path: Path) -> None:
    rgba = np.full((64, 48, 4), 255, np.uint8)
    rgba[..., :3] = np.random.default_rng(5).integers(0, 256, (64, 48, 3))
    write_image(tmp_path / "a.png", rgba)
    check_png(tmp_path / "a.png")
    write_pack(tmp_path / "pictures.h5", ["dvr"], [tmp_path / "a.png"])
    pack = open_pack(tmp_path / "pictures.h5", 1, 64, 48)
    assert np.array_equal(pack.pixels(0), rgba)
    assert pack.file(0) == ((tmp_path / "a.png").read_bytes(), True)
    data = bytearray(pack.path.read_bytes())
    data[int(pack.entries[0]["offset"]) + 40] ^= 0x10
    pack.path.write_bytes(data)
    with pytest.raises(PackError, match="image 0: Error -3 while decompressing data"):
        pack.pixels(0)


def test_either_reports_damaged_pixels_of_a_png(either: str, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    write_image(path, np.full((9, 9, 4), 200, np.uint8))
    assert read_image(path).min() == 200
    data = path.read_bytes()
    start, end = data.index(b"IDAT"), data.index(b"IEND") - 8
    body = data[start : end - 1] + bytes([data[end - 1] ^ 1])  # the last byte of the stream's own checksum
    path.write_bytes(data[:start] + body + zlib.crc32(body).to_bytes(4, "big") + data[end + 4 :])
    with pytest.raises(PngError, match="damaged: Error -3 while decompressing data"):
        check_png(path)
