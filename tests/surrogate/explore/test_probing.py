"""The place that is seen at a pixel, and the field's values there, against arithmetic on the samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from surrogate.emulation import FieldEmulator
from surrogate.explore.probing import seen_place, values_at
from surrogate.gaussians import Normalization
from surrogate.model.emulated_member import EmulatedMember

SPACING, ORIGIN, SHAPE = (0.5, 0.25, 0.4), (-2.0, 1.0, 3.0), (6, 9, 5)  # (z, y, x)
HIGH = np.array(ORIGIN) + np.array(SPACING) * (np.array(SHAPE[::-1]) - 1)
MIDDLE = (np.array(ORIGIN) + HIGH) / 2.0
WALL = TransferFunction(
    ((0.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0)), ((0.0, 0.0), (0.5, 0.0), (0.501, 1.0), (1.0, 1.0)), 1.0
)
FOG = TransferFunction(WALL.color_points, ((0.0, 0.5), (1.0, 0.5)), 2.0)
CLEAR = TransferFunction(WALL.color_points, ((0.0, 1e-4), (1.0, 1e-4)), 2.0)


def member(appearance: Any, *, holes: Any = None) -> EmulatedMember:
    """A field that rises by 0 to 1 along x whatever the parameter, with noise on top that it moves."""
    ramp = np.broadcast_to(np.linspace(0.0, 1.0, SHAPE[2]), SHAPE)
    bump = 1e-3 * np.random.default_rng(0).standard_normal(SHAPE)
    points = np.linspace(-1.0, 1.0, 7)[:, None]
    fields = np.stack([ramp + p * bump for p in points[:, 0]]).astype(np.float32)
    if holes is not None:
        fields[:, holes] = np.nan
    emulator = FieldEmulator.fit(points, fields, SPACING, ORIGIN)
    return EmulatedMember(emulator, np.zeros(1), appearance, {}, Normalization(MIDDLE, 2.0))


def along_x(**sizes: int) -> Camera:
    """A camera on the box's middle axis, looking towards larger x."""
    size = {"width": 40, "height": 30} | sizes
    return Camera.look_at(
        tuple(MIDDLE - [10.0, 0.0, 0.0]), tuple(MIDDLE), vertical_fov_degrees=20, up=(0, 0, 1), **size
    )


def test_half_of_the_opacity_lies_before_the_place() -> None:
    length = HIGH[0] - ORIGIN[0]
    depth = -np.log(1.0 - 0.5) * length / 2.0  # of the whole fog
    half = -np.log(1.0 - (1.0 - np.exp(-depth)) / 2.0) / depth  # of the length
    place = seen_place(member(VolumeRendering("fog", FOG)), along_x(), (20.0, 15.0))
    assert place == pytest.approx([ORIGIN[0] + half * length, MIDDLE[1], MIDDLE[2]], abs=1e-3 * length)


@pytest.mark.parametrize(
    "appearance", [VolumeRendering("wall", WALL), Isosurface("iso", 0.5, (1.0, 1.0, 1.0))], ids=lambda a: a.name
)
def test_a_wall_is_seen_where_it_begins(appearance: Any) -> None:
    shown, camera = member(appearance), along_x()
    place = seen_place(shown, camera, (20.0, 15.0))
    assert place == pytest.approx(MIDDLE, abs=0.08)  # a step, and the noise
    aside = seen_place(shown, camera, (23.0, 11.0))
    assert aside is not None
    x, y, depth = camera.world_to_camera[:3, :3] @ aside + camera.world_to_camera[:3, 3]
    assert (camera.cx + camera.fx * x / depth, camera.cy + camera.fy * y / depth) == pytest.approx(
        (23.0, 11.0), abs=1e-6
    )


@pytest.mark.parametrize(
    ("function", "pixel"), [(FOG, (0.0, 0.0)), (CLEAR, (20.0, 15.0))], ids=["beside the box", "too thin"]
)
def test_nothing_is_seen(function: TransferFunction, pixel: tuple[float, float]) -> None:
    assert seen_place(member(VolumeRendering("f", function)), along_x(), pixel) is None


def test_of_a_cut_what_is_left_is_seen() -> None:
    shown, camera, front = member(VolumeRendering("wall", WALL)), along_x(), MIDDLE[0] + 0.7
    place = seen_place(shown.within((front, -9.0, -9.0), (9.0, 9.0, 9.0)), camera, (20.0, 15.0))
    assert place == pytest.approx([front, *MIDDLE[1:]], abs=0.1)
    assert seen_place(shown.within(MIDDLE - 9.0, MIDDLE - 0.1), camera, (20.0, 15.0)) is None
    sliced = seen_place(shown.slice("x", front - 1.0), camera, (20.0, 15.0))  # where the wall is clear
    assert sliced == pytest.approx([front - 1.0, *MIDDLE[1:]], abs=0.01)
    assert seen_place(shown.slice("x", 99.0), camera, (20.0, 15.0)) is None


def test_what_lies_in_holes_is_not_seen() -> None:
    holes = np.zeros(SHAPE, bool)
    holes[..., 2:4] = True
    place = seen_place(member(VolumeRendering("wall", WALL), holes=holes), along_x(), (20.0, 15.0))
    assert place is None  # cells beside holes are transparent, and no other is left
    assert values_at(member(VolumeRendering("wall", WALL), holes=holes).field(), [MIDDLE]) == [None]


def test_values_are_trilinear_with_their_intervals() -> None:
    field = member(VolumeRendering("wall", WALL)).field()
    axes = [np.array(ORIGIN)[k] + np.array(SPACING)[k] * np.arange(SHAPE[2 - k]) for k in (2, 1, 0)]
    oracle = RegularGridInterpolator(axes, field.values.astype(np.float64))
    places = np.random.default_rng(1).uniform(ORIGIN, HIGH, (5, 3))
    found = values_at(field, places)
    assert [one and one["value"] for one in found] == pytest.approx(oracle(places[:, ::-1]), abs=1e-6)
    assert all(one is not None and one["half"] == pytest.approx(1.6448536 * one["deviation"]) for one in found)
    assert values_at(field, [HIGH + 1.0]) == [None]
    assert values_at(field, []) == []
