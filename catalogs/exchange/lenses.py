"""Lenses in transforms files of Blender, D-NeRF, instant-ngp and nerfstudio, and their other keys: used, harmless, or refused.

A key of a frame goes before the same one of its file.  Lengths are pixels, of pictures whose first pixel's centre is at
(0.5, 0.5).  Sources: instant-ngp, "Tips for NeRF data sets" and `nerf_loader.cu`; nerfstudio, "Data conventions".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from catalogs.exchange.records import ExchangeError, json_text, numbers

SAME = 1e-3  # relative deviation at which two statements of one length still agree
PINHOLES = {"PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV", "PERSPECTIVE"}
DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "distortion_params")
LENS = {"camera_angle_x", "camera_angle_y", "x_fov", "y_fov", "fl_x", "fl_y", "cx", "cy", "w", "h", "camera_model"}
LENS |= {"is_fisheye", "fisheye", *DISTORTION}
UNDO = "undo it in every transform_matrix, which brings the cameras back to the world of the bounds, and remove it"
UNDISTORT = "undistort the pictures first"
CUT = "cut the pictures out by an alpha channel, and remove it"
REFUSED: dict[str, tuple[tuple[Any, ...], str]] = {  # values that say nothing, and the cure for others
    "applied_transform": ((np.eye(4).tolist(), np.eye(4)[:3].tolist()), UNDO),
    "applied_scale": ((1,), UNDO),
    "orientation_override": (("none",), "remove it: cameras are taken as they are, in the world of the bounds"),
    "mask_path": ((), CUT),
    "mask_file_path": ((), CUT),
    "depth_file_path": ((), "only the pictures are imported: remove it"),
    "depth_path": ((), "only the pictures are imported: remove it"),
    "rolling_shutter": (([0, 0, 0, 0],), UNDISTORT),
}
HARMLESS = {  # how other programs train, and where pictures come from
    *("aabb_scale", "scale", "offset", "n_frames", "n_extra_learnable_dims", "render_aabb", "sharpness", "rotation"),
    *("colmap_im_id", "ply_file_path", "train_filenames", "val_filenames", "test_filenames", "camera_label"),
    *("parameter_names", "bounds"),  # of our own exports
}
READ = {"frames", "file_path", "transform_matrix", "params", "time"}


def unknown_keys(record: Mapping[str, Any], place: str) -> list[str]:
    """Keys that nobody here knows; raises ExchangeError for a key whose value changes the picture in a way that is not read."""
    for key, (allowed, cure) in REFUSED.items():
        if record.get(key) not in (None, *allowed):
            raise ExchangeError(f"{place}: {key} {json_text(record[key])} is not read: {cure}")
    return [key for key in record if key not in READ | LENS | HARMLESS | set(REFUSED)]


def lens_of(record: Mapping[str, Any], size: tuple[int, int], place: str) -> tuple[float, float, float, float]:
    """(fx, fy, cx, cy) of a picture of `size` (width, height), from the keys of its frame and file.

    Raises ExchangeError for a lens other than a pinhole, for another size, and for statements that contradict each other.
    """
    _check_pinhole(record, place)
    for key, pixels in zip("wh", size, strict=True):
        if key in record and not math.isclose(_length(record, key, place), pixels, rel_tol=1e-9):
            raise ExchangeError(
                f"{place}: {key} is {record[key]}, but the picture has {pixels} pixels: scale w, h, fl_x, fl_y, cx and cy alike"
            )
    stated = [_focals(record, axis, pixels, place) for axis, pixels in zip("xy", size, strict=True)]
    for by_key in stated:
        if by_key and max(by_key.values()) > min(by_key.values()) * (1 + SAME):
            lengths = ", ".join(f"{value:.6g}" for value in reversed(by_key.values()))
            raise ExchangeError(
                f"{place}: {' and '.join(reversed(by_key))} describe the lens differently, by focal lengths of {lengths} pixels: "
                "remove what is wrong"
            )
    focals = [next(iter(by_key.values()), 0.0) for by_key in stated]
    if not any(focals):
        raise ExchangeError(f"{place} must hold camera_angle_x or fl_x: is it a D-NeRF transforms file?")
    fx, fy = (focal or focals[1 - axis] for axis, focal in enumerate(focals))  # square pixels, where one is left out
    cx, cy = (
        _length(record, key, place) if key in record else pixels / 2.0
        for key, pixels in zip(("cx", "cy"), size, strict=True)
    )
    if not (0 < cx < size[0] and 0 < cy < size[1]):
        raise ExchangeError(f"{place}: the principal point ({cx:g}, {cy:g}) lies outside the picture of {size} pixels")
    return fx, fy, cx, cy


def _check_pinhole(record: Mapping[str, Any], place: str) -> None:
    model = str(record.get("camera_model") or "PINHOLE").upper()
    fisheye = [key for key in ("is_fisheye", "fisheye") if record.get(key)]
    if model not in PINHOLES or fisheye:
        raise ExchangeError(
            f"{place}: the camera is of the model {'fisheye' if fisheye else model}, not a pinhole: {UNDISTORT}"
        )
    distorted = [key for key in DISTORTION if np.any(np.asarray(record.get(key) or 0) != 0)]
    if distorted:
        raise ExchangeError(f"{place}: the lens is distorted ({', '.join(distorted)}): {UNDISTORT}")


def _focals(record: Mapping[str, Any], axis: str, pixels: int, place: str) -> dict[str, float]:
    """Every statement of the focal length along an axis, the most direct first."""
    direct = f"fl_{axis}"
    lengths = {direct: _length(record, direct, place)} if direct in record else {}
    for key, unit in ((f"camera_angle_{axis}", 1.0), (f"{axis}_fov", math.pi / 180)):
        if key in record:
            lengths[key] = pixels / (2.0 * math.tan(angle_of(record, key, place, unit) / 2.0))
    return lengths


def angle_of(record: Mapping[str, Any], key: str, place: str, unit: float = 1.0) -> float:
    """A field of view in radians, stated in a `unit` of as many."""
    angle = float(numbers(record[key], (), f"{place}: {key}")) * unit
    if not 0.0 < angle < math.pi:
        raise ExchangeError(f"{place}: {key} must lie in (0, pi) radians, got {angle}")
    return angle


def _length(record: Mapping[str, Any], key: str, place: str) -> float:
    value = float(numbers(record[key], (), f"{place}: {key}"))
    if value <= 0:
        raise ExchangeError(f"{place}: {key} must be a positive number of pixels, got {value:g}")
    return value
