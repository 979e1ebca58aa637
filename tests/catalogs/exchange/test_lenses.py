"""Keys of transforms files: a lens is used as it is stated, what changes a picture otherwise is refused, the rest is named."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.exchange.lenses import lens_of, unknown_keys
from catalogs.exchange.records import ExchangeError
from tests.support.nerf_data import ANGLE, HEIGHT, WIDTH, DataSet, bring

SIZE = (WIDTH, HEIGHT)
FOCAL = WIDTH / (2 * math.tan(ANGLE / 2))
UPRIGHT = 2 * math.atan(HEIGHT / (2 * FOCAL))


@pytest.fixture
def data(tmp_path: Path) -> DataSet:
    return DataSet(tmp_path / "data")


@pytest.mark.parametrize(
    ("record", "lens"),
    [
        ({"camera_angle_x": ANGLE}, (FOCAL, FOCAL, 4, 3)),
        ({"camera_angle_x": ANGLE, "camera_angle_y": UPRIGHT}, (FOCAL, FOCAL, 4, 3)),
        ({"camera_angle_x": ANGLE, "camera_angle_y": 2 * math.atan(0.5)}, (FOCAL, HEIGHT, 4, 3)),
        ({"camera_angle_y": UPRIGHT}, (FOCAL, FOCAL, 4, 3)),
        ({"x_fov": 90.0}, (4, 4, 4, 3)),
        ({"x_fov": 90.0, "y_fov": 60.0}, (4, 3 * math.sqrt(3), 4, 3)),
        ({"fl_x": 7.5}, (7.5, 7.5, 4, 3)),
        ({"fl_x": 7.5, "fl_y": 7.25, "cx": 3.5, "cy": 2.75}, (7.5, 7.25, 3.5, 2.75)),
        ({"fl_x": FOCAL * 1.0001, "camera_angle_x": ANGLE, "w": 8, "h": 6.0}, (FOCAL * 1.0001, FOCAL * 1.0001, 4, 3)),
        ({"fl_x": 9.0, "camera_model": "OPENCV", **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)}, (9, 9, 4, 3)),
        ({"fl_x": 9.0, "camera_model": "SIMPLE_PINHOLE", "is_fisheye": False}, (9, 9, 4, 3)),
    ],
)
def test_a_lens_is_used_as_it_is_stated(record: dict[str, Any], lens: tuple[float, ...]) -> None:
    assert lens_of(record, SIZE, "here") == pytest.approx(lens, rel=1e-12)
    assert unknown_keys(record, "here") == []


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({}, "here must hold camera_angle_x or fl_x"),
        ({"fl_x": 9.0, "camera_angle_x": ANGLE}, "camera_angle_x and fl_x describe the lens differently"),
        (
            {"x_fov": 50.0, "fl_y": 9.0, "y_fov": 40.0},
            "y_fov and fl_y describe the lens differently, .* 8.24.*, 9 pixels",
        ),
        ({"fl_x": 0.0}, "fl_x must be a positive number of pixels"),
        ({"fl_x": "9"}, "fl_x: '9' is not a finite number"),
        ({"camera_angle_y": 4.0}, "camera_angle_y must lie in"),
        ({"fl_x": 9.0, "w": 16}, "w is 16, but the picture has 8 pixels: scale w, h, fl_x"),
        ({"fl_x": 9.0, "h": 12}, "h is 12, but the picture has 6 pixels"),
        ({"fl_x": 9.0, "cx": 8.5}, r"principal point \(8.5, 3\) lies outside"),
        *(
            ({"fl_x": 9.0, key: 0.01}, f"distorted \\({key}\\): undistort")
            for key in ("k1", "k2", "k3", "k4", "p1", "p2")
        ),
        ({"fl_x": 9.0, "distortion_params": [0.0, 0.1]}, "distorted"),
        ({"fl_x": 9.0, "camera_model": "OPENCV_FISHEYE"}, "is of the model OPENCV_FISHEYE, not a pinhole"),
        ({"fl_x": 9.0, "camera_model": "EQUIRECTANGULAR"}, "EQUIRECTANGULAR.*: undistort the pictures"),
        ({"fl_x": 9.0, "is_fisheye": True}, "fisheye.*: undistort"),
    ],
)
def test_another_lens_is_refused(record: dict[str, Any], message: str) -> None:
    with pytest.raises(ExchangeError, match=message):
        lens_of(record, SIZE, "here")


MOVED = [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({"applied_transform": MOVED}, "here: applied_transform .* is not read: undo it in every transform_matrix"),
        ({"applied_scale": 0.5}, "applied_scale 0.5 is not read: undo it"),
        ({"orientation_override": "vertical"}, "orientation_override 'vertical' is not read: remove it"),
        ({"mask_path": "masks/0.png"}, "mask_path .* is not read: cut the pictures out by an alpha channel"),
        ({"depth_file_path": "depth/0.png"}, "depth_file_path .* is not read: only the pictures are imported"),
        ({"rolling_shutter": [0, 0, 0.1, 0]}, "rolling_shutter"),
    ],
)
def test_what_else_changes_a_picture_is_refused(record: dict[str, Any], message: str) -> None:
    with pytest.raises(ExchangeError, match=message):
        unknown_keys(record, "here")


def test_values_that_say_nothing_are_harmless() -> None:
    same = np.eye(4).tolist()
    for record in ({"applied_transform": same}, {"applied_transform": same[:3]}, {"applied_scale": 1.0}):
        assert unknown_keys({**record, "orientation_override": "none", "mask_path": None, "aabb_scale": 16}, "") == []


def test_every_frame_has_its_own_lens(data: DataSet, tmp_path: Path) -> None:
    for record in data.records.values():
        record.update(fl_x=9.0, fl_y=8.5, cx=4.25, cy=2.5, w=WIDTH, h=HEIGHT, camera_model="PINHOLE", aabb_scale=4)
        del record["camera_angle_x"]
    data.records["train"]["frames"][3].update(fl_x=10.0, cx=3.5)
    data.save()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        catalog = bring(data, tmp_path)
    lenses = {
        name: (c.fx, c.fy, c.cx, c.cy)
        for member in catalog.members
        for name, c in zip(member.provenance["pictures"], member.cameras, strict=True)
    }
    assert lenses.pop("train/r_3.png") == (10.0, 8.5, 3.5, 2.5)
    assert set(lenses.values()) == {(9.0, 8.5, 4.25, 2.5)}


@pytest.mark.parametrize(
    ("of_file", "of_frame", "pixels_per_tangent", "centre"),
    [
        ({"camera_angle_x": ANGLE, "cx": 3.0, "cy": 4.5}, {}, (FOCAL, FOCAL), (3.0, 4.5)),
        ({"camera_angle_x": ANGLE}, {"cx": 5.25}, (FOCAL, FOCAL), (5.25, 3.0)),
        ({"camera_angle_x": ANGLE, "camera_angle_y": math.pi / 2}, {}, (FOCAL, HEIGHT / 2), (4.0, 3.0)),
        ({"camera_angle_x": ANGLE}, {"camera_angle_x": math.pi / 2}, (WIDTH / 2, WIDTH / 2), (4.0, 3.0)),
        ({"fl_x": 9.0, "w": 16}, {"fl_x": 7.0, "w": WIDTH, "h": HEIGHT}, (7.0, 7.0), (4.0, 3.0)),
    ],
    ids=["off-centre", "frame's centre", "oblong pixels", "frame's angle", "frame's length and size"],
)
def test_a_point_is_seen_where_the_lens_says(
    data: DataSet,
    tmp_path: Path,
    of_file: dict[str, Any],
    of_frame: dict[str, Any],
    pixels_per_tangent: tuple[float, float],
    centre: tuple[float, float],
) -> None:
    """By OpenGL's axes of the stored pose: x to the right, y up, the camera looking along -z."""
    for record in data.records.values():
        record.pop("camera_angle_x")
        record.update(of_file)
        for frame in record["frames"]:
            frame.update(of_frame)
    data.save()
    point = np.array([0.3, -0.2, 0.45, 1.0])
    poses = {f["file_path"]: f["transform_matrix"] for r in data.records.values() for f in r["frames"]}
    for member in bring(data, tmp_path).members:
        for name, camera in zip(member.provenance["pictures"], member.cameras, strict=True):
            x, y, z, _ = np.linalg.solve(poses[f"./{name.removesuffix('.png')}"], point)
            expected = [centre[0] - pixels_per_tangent[0] * x / z, centre[1] + pixels_per_tangent[1] * y / z]
            seen = camera.world_to_camera @ point
            u, v = camera.fx * seen[0] / seen[2] + camera.cx, camera.fy * seen[1] / seen[2] + camera.cy
            assert [u, v] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("where", ["file", "frame"])
def test_keys_that_change_pictures_stop_the_import(data: DataSet, tmp_path: Path, where: str) -> None:
    record = data.records["test"] if where == "file" else data.records["train"]["frames"][3]
    record["applied_scale"] = 0.5
    data.save()
    place = r"transforms_test\.json" if where == "file" else r"transforms_train\.json, frame 3"
    with pytest.raises(ExchangeError, match=f"{place}: applied_scale 0.5 is not read"):
        bring(data, tmp_path)
    assert not (tmp_path / "out.cdb").exists()


def test_unknown_keys_are_named_once(data: DataSet, tmp_path: Path) -> None:
    for frame in data.records["train"]["frames"]:
        frame.update(exposure=0.5, rotation=0.1)
    data.records["test"]["gamma"] = 2.2
    data.save()
    with pytest.warns(
        UserWarning, match="these keys are not known, and not read: exposure .*frame 0.*, gamma"
    ) as caught:
        bring(data, tmp_path)
    assert len(caught) == 1


# ---- D-NeRF's time ---------------------------------------------------------------------------------------------------


def with_times(data: DataSet, times: list[float], params: bool) -> None:
    frames = [frame for record in data.records.values() for frame in record["frames"]]
    for number, frame in enumerate(frames):
        frame["time"] = times[number % len(times)]
        if not params:
            del frame["params"]
    data.save()


def test_each_time_is_a_member(data: DataSet, tmp_path: Path) -> None:
    with_times(data, [0.0, 0.25, 0.5, 0.75], params=False)
    catalog = bring(data, tmp_path, names=None)
    assert catalog.plan.space.names == ("time",)
    assert sorted(member.parameters["time"] for member in catalog.members) == [0.0, 0.25, 0.5, 0.75]
    assert sum(len(member.cameras) for member in catalog.members) == 29


def test_time_is_a_further_parameter_where_it_varies(data: DataSet, tmp_path: Path) -> None:
    data.records["train"]["parameter_names"] = data.records["test"]["parameter_names"] = ["a", "b"]
    with_times(data, [0.0, 1.0], params=True)
    with pytest.raises(ExchangeError, match="frames have 3 params, the last of which is time, there are 2 names"):
        bring(data, tmp_path)
    catalog = bring(data, tmp_path, names=None)
    assert catalog.plan.space.names == ("a", "b", "time")
    assert {member.parameters["time"] for member in catalog.members} == {0.0, 1.0}
    with_times(data, [0.5], params=True)
    assert bring(DataSet(tmp_path / "again"), tmp_path / "2", names=None).plan.space.names == ("p0", "p1")
    assert bring(data, tmp_path / "3", names=None).plan.space.names == ("a", "b")


def test_a_time_is_of_all_frames_or_none(data: DataSet, tmp_path: Path) -> None:
    data.records["train"]["frames"][3]["time"] = 0.5
    data.save()
    with pytest.raises(ExchangeError, match=r"frame 3 and .*frame 0: one has a time and the other none"):
        bring(data, tmp_path)
