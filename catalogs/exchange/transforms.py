"""Reading D-NeRF / Blender data sets: `transforms_{train,val,test}.json` beside their pictures.

One file holds `camera_angle_x` (full horizontal field of view, radians) and `frames`, each with

    file_path          the image, relative to the folder, with or without `.png`
    transform_matrix   camera to world, 4x4, OpenGL axes: x right, y up, z backward
    params             one number per simulation parameter

(Mildenhall et al. 2020, Blender scenes; Pumarola et al. 2021, D-NeRF; Yao et al. 2024, ViSNeRF, for `params`.)  Pixels
are square and the principal point is the middle of the image.  Files are untrusted: a path may not leave the folder, a matrix
must be rigid, a lens must be a pinhole.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.png import PngError, check_png
from catalogs.vocabulary.cameras import Camera

FILES = {"train": "transforms_train.json", "validation": "transforms_val.json", "test": "transforms_test.json"}
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
RIGID_TOLERANCE = 1e-3  # published matrices are float32, or decimals of four digits
DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
LENS = ("fl_x", "fl_y", "cx", "cy")
READERS = 4


class ExchangeError(ValueError):
    """A foreign data set can't be imported; the message names the file, the frame and the remedy."""


@dataclass(frozen=True)
class Frame:
    """One image of a data set.

    Attributes
    ----------
    path : its file, inside the data set's folder.
    file_split : "train", "validation" or "test": the transforms file that names it.
    camera : of the image's size.
    parameters : its `params`.
    has_alpha : True for RGBA, False for RGB.
    """

    path: Path
    file_split: str
    camera: Camera
    parameters: tuple[float, ...]
    has_alpha: bool


@dataclass(frozen=True)
class _Row:
    """A frame before its image is read."""

    place: str
    path: Path
    file_split: str
    angle: float
    pose: NDArray[np.float64]  # [4, 4] world to camera
    parameters: tuple[float, ...]


def read_frames(directory: Path) -> list[Frame]:
    """Every frame of the transforms files in `directory`, in the files' order, after validating all images.

    Raises ExchangeError naming the file, the frame and the problem.
    """
    if not directory.is_dir():
        raise ExchangeError(f"folder {directory} does not exist")
    rows = [row for split, name in FILES.items() for row in _read_file(directory, name, split)]
    if not any(row.file_split == "train" for row in rows):
        raise ExchangeError(f"{directory / FILES['train']} is missing or names no frame: is this a D-NeRF data set?")
    _check_agreement(rows)
    with ThreadPoolExecutor(READERS) as pool:
        frames = list(pool.map(_frame, rows))
    width, height = frames[0].camera.width, frames[0].camera.height
    for row, camera in zip(rows, (frame.camera for frame in frames), strict=True):
        if (camera.width, camera.height) != (width, height):
            raise ExchangeError(
                f"{row.place}: {row.path} is {camera.width}x{camera.height} pixels, the first picture {width}x{height}: "
                "all must have one size"
            )
    return frames


def _read_file(directory: Path, name: str, split: str) -> list[_Row]:
    path = directory / name
    if not path.is_file():
        return []
    try:
        record = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise ExchangeError(f"{path} is not valid JSON: {error}") from error
    if not isinstance(record, dict) or "camera_angle_x" not in record or not isinstance(record.get("frames"), list):
        raise ExchangeError(f"{path} must hold camera_angle_x and a list of frames: is it a D-NeRF transforms file?")
    angle = _numbers(record["camera_angle_x"], (), f"{path}: camera_angle_x")
    if not 0.0 < angle < math.pi:
        raise ExchangeError(f"{path}: camera_angle_x must lie in (0, pi) radians, got {angle}")
    _check_lens(record, f"{path}")
    folder = directory.resolve()
    return [_row(folder, frame, split, float(angle), f"{path}, frame {i}") for i, frame in enumerate(record["frames"])]


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not a JSON number")


def _row(folder: Path, frame: Any, split: str, angle: float, place: str) -> _Row:
    if not isinstance(frame, dict):
        raise ExchangeError(f"{place}: a frame must be an object, got {_short(frame)}")
    missing = [key for key in ("file_path", "transform_matrix", "params") if key not in frame]
    if missing:
        raise ExchangeError(f"{place} lacks {', '.join(missing)}")
    _check_lens(frame, place)
    params = frame["params"]
    if not isinstance(params, list) or not params:
        raise ExchangeError(f"{place}: params must be a list of numbers, got {_short(params)}")
    values = _numbers(params, (len(params),), f"{place}: params")
    pose = world_to_camera(_numbers(frame["transform_matrix"], (4, 4), f"{place}: transform_matrix"), place)
    path = _inside(folder, frame["file_path"], place)
    return _Row(place, path, split, angle, pose, tuple(values.tolist()))


def _numbers(value: Any, shape: tuple[int, ...], place: str) -> NDArray[np.float64]:
    """Finite JSON numbers nested like `shape`, as float64."""
    items = [value]
    for length in shape:
        if not all(isinstance(item, list) and len(item) == length for item in items):
            raise ExchangeError(f"{place} must hold {'x'.join(map(str, shape))} numbers, got {_short(value)}")
        items = list(chain.from_iterable(items))
    for item in items:
        if isinstance(item, bool) or not isinstance(item, int | float) or not abs(item) < 1e300:
            raise ExchangeError(f"{place}: {_short(item)} is not a finite number")
    return np.array(value, dtype=np.float64)


def _inside(folder: Path, text: Any, place: str) -> Path:
    """The image `text`: a regular file of this folder, reached without links."""
    if not isinstance(text, str) or not text or "\x00" in text or "\\" in text:
        raise ExchangeError(f"{place}: file_path must be a relative path with '/', got {_short(text)}")
    relative = PurePosixPath(text)
    if relative.is_absolute() or ".." in relative.parts:
        raise ExchangeError(f"{place}: file_path {_short(text)} leaves the data set: nothing outside {folder} is read")
    if relative.suffix.lower() != ".png":
        relative = relative.with_name(f"{relative.name}.png") if relative.name else relative
    path = folder / relative
    try:
        if path.resolve() != path:
            raise ExchangeError(f"{place}: {path} is a link, or behind one: only files of the data set itself are read")
        if not path.is_file():
            raise ExchangeError(f"{place}: {path} is missing (only PNG is read)")
    except OSError as error:
        raise ExchangeError(f"{place}: {_short(text)} can't be looked up: {error}") from error
    return path


def world_to_camera(matrix: NDArray[np.float64], place: str) -> NDArray[np.float64]:
    """World to camera (4, 4) in OpenCV axes, of a camera-to-world `matrix` (4, 4) in OpenGL axes.

    Its rotation is the nearest one, U V^T of the singular value decomposition (Schoenemann 1966).  Raises ExchangeError for
    axes further than 1e-3 from orthonormal, a mirrored frame, or a projective last row.
    """
    left, stretch, right = np.linalg.svd(matrix[:3, :3])
    rotation = left @ right  # [3, 3]
    if np.abs(stretch - 1.0).max() > RIGID_TOLERANCE or np.abs(matrix[3] - [0, 0, 0, 1]).max() > RIGID_TOLERANCE:
        raise ExchangeError(
            f"{place}: transform_matrix is not a rigid motion (its axes are stretched by {np.round(stretch, 4).tolist()})"
        )
    if np.linalg.det(rotation) < 0:
        raise ExchangeError(f"{place}: transform_matrix mirrors the world: its axes must be right-handed")
    pose = np.eye(4)
    pose[:3, :3] = OPENGL_TO_OPENCV[:3, :3] @ rotation.T
    pose[:3, 3] = -pose[:3, :3] @ matrix[:3, 3]
    return pose


def _check_lens(record: Mapping[str, Any], place: str) -> None:
    distorted = [key for key in DISTORTION if record.get(key)]
    if distorted:
        raise ExchangeError(f"{place}: the lens is distorted ({', '.join(distorted)}): undistort the pictures first")
    other = [key for key in LENS if key in record]
    if other:
        raise ExchangeError(
            f"{place}: {', '.join(other)} describe the lens beside camera_angle_x, which is not read: a centered pinhole "
            "with square pixels is known by camera_angle_x alone; remove the others where they say the same"
        )


def _check_agreement(rows: list[_Row]) -> None:
    count, angle = len(rows[0].parameters), rows[0].angle
    named: dict[Path, str] = {}
    for row in rows:
        if len(row.parameters) != count:
            raise ExchangeError(f"{row.place} has {len(row.parameters)} params, the first frame {count}")
        if not math.isclose(row.angle, angle, rel_tol=1e-6):
            raise ExchangeError(
                f"{row.place}: camera_angle_x is {row.angle}, the first file's {angle}: they must agree"
            )
        if row.path in named:
            raise ExchangeError(f"{row.place} names {row.path}, as {named[row.path]} does: a picture has one camera")
        named[row.path] = row.place


def _frame(row: _Row) -> Frame:
    """The frame of a row, after validating its image."""
    try:
        header = check_png(row.path)
    except (PngError, OSError) as error:
        raise ExchangeError(f"{row.place}: {row.path} can't be read: {error}") from error
    if not header.is_plain_color:
        raise ExchangeError(f"{row.place}: {row.path} is {header.kind}: convert it to plain 8-bit RGB or RGBA")
    width, height = header.width, header.height
    focal = width / (2.0 * math.tan(row.angle / 2.0))
    camera = Camera(row.pose, focal, focal, width / 2.0, height / 2.0, width, height)
    return Frame(row.path, row.file_split, camera, row.parameters, header.has_alpha)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
