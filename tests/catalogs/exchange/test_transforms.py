"""Foreign files say what their format means, or are refused with nothing written."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from catalogs.exchange import ExchangeError
from catalogs.exchange.transforms import read_frames, world_to_camera
from catalogs.files.png import PngError, check_png
from catalogs.vocabulary.cameras import Camera
from tests.support.nerf_data import ANGLE, HEIGHT, WIDTH, DataSet, bring, opengl_pose, picture


@pytest.fixture
def data(tmp_path: Path) -> DataSet:
    return DataSet(tmp_path / "data")


def test_the_camera_sees_what_the_definition_of_the_format_says() -> None:
    """By hand: x right, y up, looking along -z; the horizontal field of view ends at the picture's sides."""
    pose = opengl_pose(30.0, 10.0)
    focal = WIDTH / (2 * math.tan(ANGLE / 2))
    camera = Camera(world_to_camera(pose, "here"), focal, focal, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
    right, up, back, eye = pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3]
    edge = math.tan(ANGLE / 2)
    points = [eye - back + edge * right, eye - 2 * back - 2 * edge * right, eye - back + edge * HEIGHT / WIDTH * up]
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(pixels, [[WIDTH, HEIGHT / 2], [0, HEIGHT / 2], [WIDTH / 2, 0]], atol=1e-9)
    np.testing.assert_allclose(depth, [1, 2, 1])


@given(st.integers(0, 10**6), st.floats(-180, 180), st.floats(-80, 80))
@settings(max_examples=50)
def test_an_inexact_rotation_becomes_the_nearest_exact_one(seed: int, azimuth: float, elevation: float) -> None:
    exact = opengl_pose(azimuth, elevation)
    noise = np.zeros((4, 4))
    noise[:3, :3] = np.random.default_rng(seed).uniform(-1e-4, 1e-4, (3, 3))
    rotation = world_to_camera(exact + noise, "here")[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    given_axes = (exact + noise)[:3, :3] @ np.diag([1, -1, -1])
    # The nearest rotation in the Frobenius norm: no small turn of it is nearer.
    nearest = np.linalg.norm(given_axes - rotation.T)
    for axis in np.eye(3):
        for angle in (-1e-5, 1e-5):
            turn = np.eye(3) + angle * np.cross(np.eye(3), axis)
            assert np.linalg.norm(given_axes - rotation.T @ turn) >= nearest - 1e-9


def test_reading_keeps_the_order_of_the_files(data: DataSet) -> None:
    frames = read_frames(data.folder)
    assert [f.path.stem for f in frames] == [f"r_{i}" for i in range(29)]
    assert {f.file_split for f in frames[:24]} == {"train"}


def _frame(change: dict[str, Any]) -> Callable[[DataSet], None]:
    return lambda data: data.records["train"]["frames"][3].update(change)


def _drop(key: str) -> Callable[[DataSet], None]:
    return lambda data: data.records["train"]["frames"][3].pop(key)


def _matrix(change: Callable[[np.ndarray], Any]) -> Callable[[DataSet], None]:
    return _frame({"transform_matrix": np.asarray(change(opengl_pose(20.0))).tolist()})


def _record(change: dict[str, Any]) -> Callable[[DataSet], None]:
    return lambda data: data.records["test"].update(change)


HOSTILE_RECORDS: list[tuple[Callable[[DataSet], Any], str]] = [
    (_drop("file_path"), r"transforms_train\.json, frame 3 lacks file_path"),
    (_drop("params"), "frame 3 lacks params"),
    (_drop("transform_matrix"), "frame 3 lacks transform_matrix"),
    (_frame({"params": []}), "params must be a list of numbers"),
    (_frame({"params": "12"}), "params must be a list of numbers"),
    (_frame({"params": [1.0, "2"]}), "'2' is not a finite number"),
    (_frame({"params": [1.0, True]}), "True is not a finite number"),
    (_frame({"params": [1.0, None]}), "None is not a finite number"),
    (_frame({"params": [1.0, 10**400]}), "is not a finite number"),
    (_frame({"params": [1.0, 2.0, 3.0]}), "frame 3 has 3 params, the first frame 2"),
    (_frame({"params": [1.0, float("nan")]}), "NaN is not a JSON number"),
    (_frame({"params": [1.0, float("inf")]}), "Infinity is not a JSON number"),
    (_matrix(lambda m: m[:3]), "transform_matrix must hold 4x4 numbers"),
    (_matrix(lambda m: m * 1.01), "stretched by"),
    (_matrix(lambda m: m @ np.diag([1, 1, -1, 1])), "mirrors the world"),
    (_matrix(lambda m: m + np.eye(4)[[3, 0, 1, 2]] * 0.1), "not a rigid motion"),
    (_matrix(lambda m: m * 0), "not a rigid motion"),
    (_frame({"transform_matrix": [[1, 2], [3]]}), "must hold 4x4 numbers"),
    (_frame({"transform_matrix": 1.0}), "must hold 4x4 numbers"),
    (_frame({"file_path": "../data/train/r_3"}), "leaves the data set"),
    (_frame({"file_path": "/etc/passwd"}), "leaves the data set"),
    (_frame({"file_path": "train/../../secret"}), "leaves the data set"),
    (_frame({"file_path": "..\\secret"}), "relative path with '/'"),
    (_frame({"file_path": "train/r_3\x00"}), "relative path with '/'"),
    (_frame({"file_path": ""}), "relative path with '/'"),
    (_frame({"file_path": 7}), "relative path with '/'"),
    (_frame({"file_path": "x" * 5000}), "can't be looked up|is missing"),
    (_frame({"file_path": "."}), "is missing"),
    (_frame({"file_path": "train/none"}), r"none\.png is missing"),
    (_frame({"file_path": "train/r_4"}), "as .*frame 4 does|as .*frame 3 does"),
    (_frame({"k1": 0.1}), "distorted"),
    (_record({"camera_angle_x": 0.0}), "camera_angle_x must lie in"),
    (_record({"camera_angle_x": 3.2}), "camera_angle_x must lie in"),
    (_record({"camera_angle_x": "wide"}), "camera_angle_x: 'wide' is not a finite number"),
    (_record({"camera_angle_x": ANGLE + 0.1}), "they must agree"),
    (_record({"frames": {}}), "must hold camera_angle_x and a list of frames"),
    (_record({"frames": [3]}), "frame 0: a frame must be an object"),
    (_record({"k1": 0.5}), "distorted"),
    (_record({"fl_x": 100.0}), "fl_x describe the lens"),
    (lambda data: data.records["train"].update(frames=[]), "is missing or names no frame"),
    (lambda data: data.records["train"].pop("camera_angle_x"), "must hold camera_angle_x"),
]


@pytest.mark.parametrize(("spoil", "message"), HOSTILE_RECORDS)
def test_hostile_records_write_nothing(
    data: DataSet, tmp_path: Path, spoil: Callable[[DataSet], Any], message: str
) -> None:
    spoil(data)
    data.save()
    with pytest.raises(ExchangeError, match=message):
        bring(data, tmp_path)
    assert not (tmp_path / "out.cdb").exists()


def _write(name: str, content: bytes) -> Callable[[DataSet], Any]:
    return lambda data: (data.folder / name).write_bytes(content)


def _cut(data: DataSet) -> None:
    path = data.folder / "train/r_5.png"
    path.write_bytes(path.read_bytes()[:-20])


def _flip(data: DataSet) -> None:
    path = data.folder / "train/r_5.png"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x40
    path.write_bytes(content)


def _save(size: tuple[int, int], mode: str, **options: Any) -> Callable[[DataSet], None]:
    return lambda data: Image.new(mode, size).save(data.folder / "train/r_5.png", **options)


def _link(target: str) -> Callable[[DataSet], None]:
    def spoil(data: DataSet) -> None:
        path = data.folder / "train/r_5.png"
        moved = data.folder.parent / "secret.png" if target == "outside" else data.folder / "other.png"
        path.rename(moved)
        path.symlink_to(moved)

    return spoil


def _link_folder(data: DataSet) -> None:
    (data.folder / "train").rename(data.folder.parent / "elsewhere")
    (data.folder / "train").symlink_to(data.folder.parent / "elsewhere")


def png(width: int, height: int, pixels: bytes, color_type: int = 2) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, color_type, 0, 0, 0)
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


ROW = b"\x00" + bytes(3 * WIDTH)
HOSTILE_FILES: list[tuple[Callable[[DataSet], Any], str]] = [
    (_write("transforms_test.json", b"{"), r"transforms_test\.json is not valid JSON"),
    (_write("transforms_test.json", b"\xff\xfe"), "not valid JSON"),
    (_write("transforms_test.json", b"[" * 100_000), "not valid JSON"),
    (_write("transforms_test.json", b"[]"), "must hold camera_angle_x"),
    (lambda data: (data.folder / "transforms_train.json").unlink(), "is missing or names no frame"),
    (_cut, r"frame 5: .*r_5\.png can't be read: it is truncated"),
    (_flip, "it is damaged"),
    (_write("train/r_5.png", b""), "it is not a PNG"),
    (_write("train/r_5.png", b"\xff\xd8\xff\xe0JFIF"), "it is not a PNG"),
    (_write("train/r_5.png", png(WIDTH, HEIGHT, ROW * (HEIGHT - 1))), "its pixels fill 125 bytes, 8x6 need 150"),
    (_write("train/r_5.png", png(WIDTH, HEIGHT, ROW * HEIGHT + b"\x00")), "its pixels fill 151 bytes"),
    (_write("train/r_5.png", png(WIDTH, HEIGHT, b"\x09" + (ROW * HEIGHT)[1:])), "an invalid filter"),
    (_write("train/r_0.png", png(60_000, 60_000, bytes(100))), "it claims 60000x60000 pixels"),
    (_write("train/r_5.png", png(WIDTH, HEIGHT, bytes(5_000_000))), "its pixels fill 151 bytes"),
    (_save((WIDTH + 1, HEIGHT), "RGB"), r"r_5\.png is 9x6 pixels, the first picture 8x6"),
    (_save((WIDTH, HEIGHT), "L"), "8-bit gray: convert it"),
    (_save((WIDTH, HEIGHT), "P"), "palette: convert it"),
    (_save((WIDTH, HEIGHT), "I;16"), "16-bit gray: convert it"),
    (_link("outside"), "is a link, or behind one"),
    (_link("inside"), "is a link, or behind one"),
    (_link_folder, "is a link, or behind one"),
]


@pytest.mark.parametrize(("spoil", "message"), HOSTILE_FILES)
def test_hostile_files_write_nothing(
    data: DataSet, tmp_path: Path, spoil: Callable[[DataSet], Any], message: str
) -> None:
    spoil(data)
    with pytest.raises(ExchangeError, match=message):
        bring(data, tmp_path)
    assert not (tmp_path / "out.cdb").exists()


@given(st.integers(0, 2**32), st.integers(1, 4))
@settings(max_examples=40)
def test_no_damaged_picture_passes(tmp_path_factory: pytest.TempPathFactory, seed: int, changes: int) -> None:
    """Whatever bytes change, either the reader complains or an independent decoder still sees the same pixels."""
    path = tmp_path_factory.getbasetemp() / "damaged.png"
    Image.fromarray(picture(1)).save(path)
    content = bytearray(path.read_bytes())
    generator = np.random.default_rng(seed)
    for place in generator.integers(0, len(content), changes):
        content[place] ^= 1 << generator.integers(8)
    path.write_bytes(content)
    try:
        check_png(path)
    except PngError:
        return
    np.testing.assert_array_equal(np.asarray(Image.open(path)), picture(1))
