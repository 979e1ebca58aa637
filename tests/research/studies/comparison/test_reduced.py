"""Smaller pictures are means of areas, of the same members, views and splits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.splits import Splits
from research.studies.comparison import reduced as module
from research.studies.comparison.reduced import area_means, reduced, smaller
from tests.support.blobs import Blobs


@pytest.mark.parametrize(("side", "after"), [(6, 3), (6, 4), (7, 5), (5, 5), (192, 128), (9, 1)])
def test_a_new_pixel_is_the_mean_of_its_area(side: int, after: int) -> None:
    pixels = np.random.default_rng(side).integers(0, 256, (side, side, 4), dtype=np.uint8)
    fine = math.lcm(side, after)  # a whole number of these pixels lies in each old and each new one
    repeated = np.repeat(np.repeat(pixels.astype(np.float64), fine // side, axis=0), fine // side, axis=1)
    expected = repeated.reshape(after, fine // after, after, fine // after, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(area_means(pixels, after, after), expected, atol=0.5 + 1e-3)


def test_width_and_height_are_not_exchanged() -> None:
    pixels = np.zeros((4, 8, 4), dtype=np.uint8)
    pixels[0] = 200
    found = area_means(pixels, 4, 2)
    assert found.shape == (2, 4, 4)
    assert (found[0] == 100).all()
    assert (found[1] == 0).all()


@pytest.mark.parametrize("value", [0, 1, 127, 254, 255])
def test_equal_pixels_stay_and_opaque_ones_are_opaque(value: int) -> None:
    assert (area_means(np.full((192, 192, 4), value, dtype=np.uint8), 128, 128) == value).all()


def test_premultiplied_pictures_stay_so() -> None:
    random = np.random.default_rng(0)
    alpha = random.integers(0, 256, (96, 96, 1))
    pixels = np.concatenate([alpha * random.random((96, 96, 3)), alpha], axis=2).astype(np.uint8)
    found = area_means(pixels, 64, 64)
    assert (found[..., :3] <= found[..., 3:]).all()


def test_small_catalogs_are_taken_as_they_are(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(Blobs(count=2, size=16))
    assert reduced(catalog, tmp_path / "small.cdb") is catalog
    assert not (tmp_path / "small.cdb").exists()


def test_members_views_and_splits_stay(make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SIDE", 8)
    catalog = make_catalog(Blobs(count=2, size=12), members=(("train", 0.0), ("test", 1.0)))
    made = reduced(catalog, tmp_path / "small.cdb")
    assert [(m.name, m.split, m.parameters, m.view_splits) for m in made.members] == [
        (m.name, m.split, m.parameters, m.view_splits) for m in catalog.members
    ]
    member = made.members[1]
    camera = member.cameras[3]
    assert (camera.width, camera.height) == (8, 8)
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
    np.testing.assert_allclose(camera.project(points)[0] * 12 / 8, catalog.members[1].cameras[3].project(points)[0])
    np.testing.assert_array_equal(
        made.image(member, "drawn", 3), area_means(catalog.image(member.name, "drawn", 3), 8, 8)
    )


def test_what_is_there_is_not_made_again(make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SIDE", 8)
    catalog = make_catalog(Blobs(count=2, size=12))
    made = reduced(catalog, tmp_path / "small.cdb")
    path = made.image_path("member-0", "drawn", 0)
    before = path.stat().st_mtime_ns
    reduced(catalog, tmp_path / "small.cdb")
    assert path.stat().st_mtime_ns == before


def test_splits_that_a_run_chose_are_kept(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(Blobs(count=2, size=12))
    chosen = catalog.with_splits(Splits({"member-0": "train", "member-1": "test", "member-2": "train"}))
    made = reduced(chosen, tmp_path / "small.cdb")
    assert [m.split for m in made.members] == [m.split for m in chosen.members] == ["train", "test", "train"]


def test_a_camera_that_is_not_square_keeps_its_shape() -> None:
    camera = Blobs(size=16).cameras()[0].resized(300, 150)
    assert (smaller(camera).width, smaller(camera).height) == (128, 64)
