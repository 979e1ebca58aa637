"""Marks on pictures stand where the camera sees what they mark."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.files.images import read_image
from catalogs.vocabulary.cameras import Camera
from surrogate.appearance.scale import ValueScale
from surrogate.explore.exporting.annotations import BACK, FRONT, Annotations, Legend, nice_numbers
from surrogate.explore.exporting.commands import export, sweep
from surrogate.explore.exporting.exports import PictureRequest
from surrogate.explore.exporting.marks import annotated
from surrogate.explore.setting import Setting
from surrogate.storage.picture_records import record_of
from tests.support.field_blobs import FUNCTION
from tests.support.models import following

BOX = np.array([[-1.0, 2.0, 0.0], [3.0, 4.0, 1.0]])
CENTER = BOX.mean(axis=0)
LEGEND = Legend(FUNCTION, ValueScale.of_function(FUNCTION), "Q (1/s²)")


def seen_from(direction: Any, far: float = 8.0, size: tuple[int, int] = (640, 480)) -> Camera:
    place = CENTER + far * np.array(direction) / np.linalg.norm(direction)
    return Camera.look_at(place, CENTER, vertical_fov_degrees=40.0, width=size[0], height=size[1])


def marks(camera: Camera, *shown: str) -> list[Any]:
    return Annotations("a title", "p=0.5", BOX, LEGEND, shown).marks(camera)


DIRECTIONS = {"a corner": (1.0, -2.0, 0.7), "below": (-1.0, 0.5, -0.6), "a face": (0.0, -1.0, 0.0), "a pole": (0, 0, 1)}


@pytest.mark.parametrize("direction", DIRECTIONS.values(), ids=DIRECTIONS)
def test_edges_are_the_box_as_the_camera_projects_it(direction: Any) -> None:
    camera = seen_from(direction)
    corners = [np.array([BOX[i, 0], BOX[j, 1], BOX[k, 2]]) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    projected, depths = camera.project(np.array(corners))
    lines = [mark for mark in marks(camera, "box") if mark[0] == "line"][:12]
    ends = np.array([line[1] for line in lines]).reshape(-1, 2)
    np.testing.assert_allclose(np.abs(ends[:, None] - projected[None]).max(axis=2).min(axis=1), 0.0, atol=1e-9)
    hidden = {tuple(np.round(line[1], 6)) for line in lines if line[2] == BACK}
    farthest = tuple(np.round(projected[int(np.argmax(depths))], 6))
    if direction == DIRECTIONS["a corner"]:  # three faces are seen: what meets in the farthest corner is hidden
        assert len(hidden) == 3
        assert all(farthest in (one[:2], one[2:]) for one in hidden)
    else:
        assert len(hidden) >= 3


@pytest.mark.parametrize("direction", [DIRECTIONS["a corner"], DIRECTIONS["below"]])
def test_ticks_stand_where_their_numbers_are(direction: Any) -> None:
    camera = seen_from(direction)
    drawn = marks(camera, "box")
    ticks = {
        mark[1][:2]: float(text[4].replace("−", "-"))
        for mark, text in itertools.pairwise(drawn)
        if mark[0] == "line" and text[0] == "text" and text[3] == 11
    }
    assert len(ticks) >= 6
    names = [mark[4] for mark in drawn if mark[0] == "text" and mark[3] == 13]
    assert names == ["x", "y", "z"]
    for place, value in ticks.items():
        edges = [
            np.where(np.arange(3) == axis, value, np.array([BOX[i, 0], BOX[j, 1], BOX[k, 2]]))
            for axis in range(3)
            for i in (0, 1)
            for j in (0, 1)
            for k in (0, 1)
        ]
        points, _ = camera.project(np.array(edges))
        assert np.abs(points - place).max(axis=1).min() < 1e-9


def texts_around(scale: float) -> list[tuple[int, list[Any]]]:
    """Of a cube from 48 sides: how many ticks there are, and the texts of numbers and names."""
    cube = Annotations("", "", np.array([[-1.0] * 3, [1.0] * 3]), None, ("box",))
    found = []
    for turn in np.linspace(0.0, 2 * math.pi, 48, endpoint=False):
        camera = Camera.look_at(
            6.0 * np.array([math.cos(turn), math.sin(turn), 0.6]),
            np.zeros(3),
            vertical_fov_degrees=30.0,
            width=round(600 * scale),
            height=round(600 * scale),
        )
        drawn = cube.marks(camera)
        found.append((sum(mark[0] == "line" for mark in drawn) - 12, [mark for mark in drawn if mark[0] == "text"]))
    return found


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_numbers_at_a_corner_do_not_lie_over_each_other(scale: float) -> None:
    views = texts_around(scale)
    for _, texts in views:
        for one, other in itertools.combinations(texts, 2):
            (left, right), (top, bottom) = zip(extent(one, scale), extent(other, scale), strict=True)
            across = min(left[1], right[1]) - max(left[0], right[0])
            down = min(top[1], bottom[1]) - max(top[0], bottom[0])
            assert across < 0 or down < 0, (one, other)
        assert {mark[4] for mark in texts if mark[3] == 13} >= {"x", "y"}
    numbers = [sum(mark[3] == 11 for mark in texts) for _, texts in views]
    missing = [ticks - count for (ticks, _), count in zip(views, numbers, strict=True)]
    assert 0 < sum(count > 0 for count in missing) < len(views)  # none where there is room
    assert max(missing) <= 3


def extent(mark: Any, scale: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """The place of a text across and down, by letters half as wide as tall."""
    _, (x, y), anchor, letter, text, _ = mark
    width = 0.5 * letter * scale * len(text)
    left = x - {"start": 0.0, "middle": width / 2, "end": width}[anchor]
    return (left, left + width), (y - 0.4 * letter * scale, y + 0.4 * letter * scale)


def test_inside_the_box_edges_are_cut_before_the_camera() -> None:
    camera = Camera.look_at(CENTER, CENTER + np.array([1.0, 0.2, 0.1]), vertical_fov_degrees=60.0, width=64, height=48)
    lines = [mark for mark in marks(camera, "box") if mark[0] == "line"]
    assert np.isfinite([line[1] for line in lines]).all()
    assert 0 < len(lines) < 12
    assert {line[2] for line in lines} == {BACK}


NUMBERS: list[tuple[tuple[float, float, int], list[str]]] = [
    ((0.0, 2 * math.pi, 4), ["0", "2", "4", "6"]),
    ((-1.0, 1.0, 4), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]),
    ((0.0, 1.0, 1), ["0", "1"]),
    ((0.0, 3e6, 3), ["0.00e+0", "1.00e+6", "2.00e+6", "3.00e+6"]),
    ((0.0, 2e-6, 2), ["0.00e+0", "1.00e-6", "2.00e-6"]),
    ((1e6 - 30.0, 1e6 + 30.0, 3), ["9.99980e+5", "1.00000e+6", "1.00002e+6"]),
]


@pytest.mark.parametrize(("asked", "texts"), NUMBERS)
def test_numbers_of_ticks_are_round(asked: tuple[float, float, int], texts: list[str]) -> None:
    values, found = nice_numbers(*asked)
    assert found == [text.replace("-", "−") for text in texts]
    assert asked[0] - 1e-9 <= values[0] <= values[-1] <= asked[1] + 1e-9
    assert len(values) <= asked[2] + 1


def test_a_legend_has_the_colours_and_opacities_of_its_function() -> None:
    drawn = marks(seen_from((1, 1, 1)), "legend")
    colors = [mark[2] for mark in drawn if mark[0] == "rect"]
    for share, color in ((0.25, colors[15]), (0.75, colors[48])):
        expected = FUNCTION.colors(LEGEND.scale.values(share))
        found = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        assert found == pytest.approx(list(expected), abs=0.05)
    (path,) = (mark[1] for mark in drawn if mark[0] == "path")
    (axis,) = (mark for mark in drawn if mark[0] == "line" and mark[2] == BACK)
    shares = (np.array(path)[:, 0] - axis[1][0]) / 26 / (480 / 600)
    expected = FUNCTION.opacities(LEGEND.scale.values(np.arange(65) / 64))
    np.testing.assert_allclose(shares, expected, atol=1e-9)
    assert "Q (1/s²), line: opacity" in [mark[4] for mark in drawn if mark[0] == "text"]


@pytest.mark.parametrize("background", [None, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])
def test_pictures_show_through_and_ink_is_seen(background: Any) -> None:
    camera = seen_from((1.0, -2.0, 0.7), size=(320, 240))
    channels = 4 if background is None else 3
    picture = np.full((240, 320, channels), 0.5 if background is None else background[0], np.float32)
    drawn = annotated(picture, Annotations("a title", "", BOX, LEGEND), camera, background)
    assert drawn.dtype == np.float32
    assert drawn.shape == picture.shape
    changed = (np.abs(drawn - picture) > 0.1).any(axis=2).mean()
    assert 0.005 < changed < 0.2
    assert 0.0 <= drawn.min() <= drawn.max() <= 1.0


def test_commands_annotate_and_files_say_so(tmp_path: Path) -> None:
    following().save(tmp_path / "surrogate")
    pictures = {}
    for name, options in {
        "plain": [],
        "noted": ["--annotate"],
        "again": ["--like", str(tmp_path / "noted.png")],
    }.items():
        asked = [str(tmp_path), "--size", "200", "--background", "1,1,1", *options, "-o", str(tmp_path / f"{name}.png")]
        done = CliRunner().invoke(export, asked)
        assert done.exit_code == 0, done.output
        pictures[name] = read_image(tmp_path / f"{name}.png")
    np.testing.assert_array_equal(pictures["noted"], pictures["again"])
    assert (pictures["noted"] != pictures["plain"]).any(axis=2).mean() > 0.01
    assert record_of(tmp_path / "noted.png")["annotations"] == ["title", "legend", "box", "axes"]
    film = [str(tmp_path), "--over", "p", "--steps", "3", "--size", "64", "--annotate", "-o", str(tmp_path / "a.gif")]
    assert CliRunner().invoke(sweep, film).exit_code == 0
    for ending in ("ply", "exr"):
        refused = CliRunner().invoke(export, [str(tmp_path), "--annotate", "-o", str(tmp_path / f"a.{ending}")])
        assert refused.exit_code
        assert "annotat" in refused.output


def test_a_picture_that_keeps_every_bit_has_no_annotations() -> None:
    with pytest.raises(ValueError, match="an EXR keeps the picture alone"):
        PictureRequest(Setting({"p": 0.5}), seen_from((1, 0, 0)), None, "exr", ("box",))
    assert FRONT > BACK
