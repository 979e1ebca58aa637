"""Reading D-NeRF / Blender data sets: `transforms_{train,val,test}.json` beside their pictures.

One file holds `camera_angle_x` (full horizontal field of view, radians) and `frames`, each with

    file_path          the image, relative to the folder, with or without `.png`
    transform_matrix   camera to world, 4x4, OpenGL axes: x right, y up, z backward
    params             one number per simulation parameter
    time               a further parameter, where frames differ in it

(Mildenhall et al. 2020, Blender scenes; Pumarola et al. 2021, D-NeRF; Yao et al. 2024, ViSNeRF, for `params`.)  Pixels
are square and the principal point is the middle of the image, unless keys of the lens say otherwise (`lenses`).  Files are
untrusted: a path may not leave the folder, a matrix must be rigid, a lens must be a pinhole.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.exchange.lenses import angle_of, lens_of, unknown_keys
from catalogs.exchange.records import ExchangeError, json_text, numbers
from catalogs.files.png import PngError, check_png
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import shortened

FILES = {"train": "transforms_train.json", "validation": "transforms_val.json", "test": "transforms_test.json"}
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
RIGID_TOLERANCE = 1e-3  # published matrices are float32, or decimals of four digits
READERS = 4


@dataclass(frozen=True)
class Frame:
    """One image of a data set.

    Attributes
    ----------
    path : its file, inside the data set's folder.
    file_split : "train", "validation" or "test": the transforms file that names it.
    camera : of the image's size.
    parameters : its `params`, and its `time`.
    names : of the parameters: the file's `parameter_names`, or p0, p1, ..., and time.
    has_alpha : True for RGBA, False for RGB.
    """

    path: Path
    file_split: str
    camera: Camera
    parameters: tuple[float, ...]
    has_alpha: bool
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Row:
    """A frame before its image is read."""

    place: str
    path: Path
    file_split: str
    lens: Mapping[str, Any]
    angle: float | None  # that of the file
    pose: NDArray[np.float64]  # [4, 4] world to camera
    parameters: tuple[float, ...]
    time: float | None
    names: tuple[str, ...]
    unknown: tuple[str, ...]


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
    _warn_of_unknown(rows)
    rows = _with_time(rows)
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
    if not isinstance(record, dict) or not isinstance(record.get("frames"), list):
        raise ExchangeError(f"{path} must hold camera_angle_x and a list of frames: is it a D-NeRF transforms file?")
    unknown = unknown_keys(record, f"{path}")
    folder, common = directory.resolve(), {key: value for key, value in record.items() if key != "frames"}
    if "camera_angle_x" in common:
        common["camera_angle_x"] = angle_of(common, "camera_angle_x", f"{path}")
    rows = [_row(folder, frame, split, common, f"{path}, frame {i}") for i, frame in enumerate(record["frames"])]
    return [replace(row, unknown=(*unknown, *row.unknown)) for row in rows]


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not a JSON number")


def _row(folder: Path, frame: Any, split: str, common: Mapping[str, Any], place: str) -> _Row:
    if not isinstance(frame, dict):
        raise ExchangeError(f"{place}: a frame must be an object, got {json_text(frame)}")
    missing = [key for key in ("file_path", "transform_matrix") if key not in frame]
    if "params" not in frame and "time" not in frame:
        missing.append("params")
    if missing:
        raise ExchangeError(f"{place} lacks {', '.join(missing)}")
    params = frame.get("params", [])
    if not isinstance(params, list) or (not params and "params" in frame):
        raise ExchangeError(f"{place}: params must be a list of numbers, got {json_text(params)}")
    values = numbers(params, (len(params),), f"{place}: params").tolist()
    time = float(numbers(frame["time"], (), f"{place}: time")) if "time" in frame else None
    pose = world_to_camera(numbers(frame["transform_matrix"], (4, 4), f"{place}: transform_matrix"), place)
    path, names = _inside(folder, frame["file_path"], place), common.get("parameter_names")
    if not isinstance(names, list) or len(names) != len(params) or not all(isinstance(name, str) for name in names):
        names = [f"p{i}" for i in range(len(params))]
    lens, unknown = {**common, **frame}, tuple(unknown_keys(frame, place))
    return _Row(
        place, path, split, lens, common.get("camera_angle_x"), pose, tuple(values), time, tuple(names), unknown
    )


def _inside(folder: Path, text: Any, place: str) -> Path:
    """The image `text`: a regular file of this folder, reached without links."""
    if not isinstance(text, str) or not text or "\x00" in text or "\\" in text:
        raise ExchangeError(f"{place}: file_path must be a relative path with '/', got {json_text(text)}")
    relative = PurePosixPath(text)
    if relative.is_absolute() or ".." in relative.parts:
        raise ExchangeError(
            f"{place}: file_path {json_text(text)} leaves the data set: nothing outside {folder} is read"
        )
    if relative.suffix.lower() != ".png":
        relative = relative.with_name(f"{relative.name}.png") if relative.name else relative
    path = folder / relative
    try:
        if path.resolve() != path:
            raise ExchangeError(f"{place}: {path} is a link, or behind one: only files of the data set itself are read")
        if not path.is_file():
            raise ExchangeError(f"{place}: {path} is missing (only PNG is read)")
    except OSError as error:
        raise ExchangeError(f"{place}: {json_text(text)} can't be looked up: {error}") from error
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


def _check_agreement(rows: list[_Row]) -> None:
    count, angle = len(rows[0].parameters), next((row.angle for row in rows if row.angle is not None), 0.0)
    named: dict[Path, str] = {}
    for row in rows:
        if len(row.parameters) != count:
            raise ExchangeError(f"{row.place} has {len(row.parameters)} params, the first frame {count}")
        if (row.time is None) != (rows[0].time is None):
            raise ExchangeError(f"{row.place} and {rows[0].place}: one has a time and the other none")
        if row.angle is not None and not math.isclose(row.angle, angle, rel_tol=1e-6):
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
    camera = Camera(row.pose, *lens_of(row.lens, (width, height), row.place), width, height)
    return Frame(row.path, row.file_split, camera, row.parameters, header.has_alpha, row.names)


def _with_time(rows: list[_Row]) -> list[_Row]:
    """The rows with their times as a last parameter, unless they have others, and times are all the same."""
    if rows[0].time is None or (rows[0].parameters and len({row.time for row in rows}) == 1):
        return rows
    return [
        replace(row, parameters=(*row.parameters, row.time or 0.0), names=(*row.names, "time"), time=None)
        for row in rows
    ]


def _warn_of_unknown(rows: list[_Row]) -> None:
    """Warn once of the keys that nobody here knows."""
    first: dict[str, str] = {}
    for row in rows:
        for key in row.unknown:
            first.setdefault(key, row.place)
    if first:
        named = shortened([f"{key} ({place})" for key, place in first.items()], 8)
        warnings.warn(f"these keys are not known, and not read: {named}", stacklevel=4)
