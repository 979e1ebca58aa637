"""The one call: its order, its defaults and what cannot be drawn."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.appearance import ImportedImages, Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import orbit
from render import render_views
from render.views import Renderer


def test_one_picture_per_camera_in_order_and_lazily(gyroid, smooth) -> None:
    cameras = orbit(gyroid.center, gyroid.bounding_radius, width=24, height=16, frequency=1)
    taken = []

    def one_by_one():
        for number, camera in enumerate(cameras):
            taken.append(number)
            yield camera

    pictures = render_views(gyroid, VolumeRendering("dvr", smooth), one_by_one(), backend="vtk")
    with Renderer(gyroid, VolumeRendering("dvr", smooth), sample_distance=0.04) as volume:
        for number, camera in enumerate(cameras):
            np.testing.assert_array_equal(next(pictures), volume.render(camera))
            assert taken[-1] == number
    assert next(pictures, None) is None


def test_leaving_early_frees_the_renderer(gyroid, smooth, monkeypatch) -> None:
    closed = []
    monkeypatch.setattr(Renderer, "close", lambda self: closed.append(self))
    cameras = orbit(gyroid.center, gyroid.bounding_radius, width=8, height=8, frequency=1)
    pictures = render_views(gyroid, VolumeRendering("dvr", smooth), cameras, backend="vtk")
    next(pictures)
    pictures.close()
    assert len(closed) == 1


def test_volumes_and_isosurfaces_may_be_drawn_in_turn(gyroid, smooth) -> None:
    cameras = orbit(gyroid.center, gyroid.bounding_radius, width=24, height=24, frequency=1)[:3]
    volume, surface = VolumeRendering("dvr", smooth), Isosurface("iso", 0.2)
    apart, turns = (
        [render_views(gyroid, appearance, cameras, backend="vtk") for appearance in (volume, surface)] for _ in "ab"
    )
    apart = [list(pictures) for pictures in apart]
    turns = zip(*turns, strict=True)
    for number, (one, other) in enumerate(turns):
        np.testing.assert_array_equal(one, apart[0][number])
        np.testing.assert_array_equal(other, apart[1][number])


def test_imported_pictures_cannot_be_rendered(gyroid) -> None:
    with pytest.raises(TypeError, match="ImportedImages 'theirs' cannot be rendered from a field"):
        next(render_views(gyroid, ImportedImages("theirs"), []))
