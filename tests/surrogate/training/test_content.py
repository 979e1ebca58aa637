"""The content of images, and its change from member to member."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import Camera
from surrogate.settings import TrainingSettings
from surrogate.training.content import changing_share, roughness, sampled, visible_pixels
from surrogate.training.data import training_rows
from surrogate.training.source import Source
from tests.support.results import BLOBS

CAMERAS = BLOBS.cameras()
Pictures = Sequence[tuple[int, NDArray[np.uint8]]]  # of a member: the number of a camera, and what it shows


def catalog_of(
    path: Path, members: Sequence[Pictures], background: tuple[float, float, float] | None = None
) -> Catalog:
    """Members with cameras of their own."""
    plan = CatalogPlan(BLOBS.space, (ImportedImages("drawn"),), (), (), BLOBS.bounds, background)
    catalog = Catalog.create(path / "catalog.cdb", plan)
    for number, pictures in enumerate(members):
        cameras: list[Camera] = [CAMERAS[camera] for camera, _ in pictures]
        splits = ("train",) * len(cameras)
        with catalog.begin_member(
            f"m{number}", {"p": 0.1 * number}, split="train", cameras=cameras, view_splits=splits
        ) as writer:
            for view, (_, picture) in enumerate(pictures):
                writer.write_image("drawn", view, picture)
    return Catalog.open(catalog.path)


def share(catalog: Catalog) -> float:
    source = Source(TrainingSettings(), catalog)
    return changing_share(source, training_rows(catalog, [source.appearance]))


def square(at: int, value: int = 200, background: tuple[float, float, float] | None = None) -> NDArray[np.uint8]:
    picture = np.zeros((16, 16, 4), np.uint8)
    picture[..., 3] = 255 if background else 0
    picture[..., :3] = np.round(255.0 * np.array(background or (0.0, 0.0, 0.0)))
    picture[at : at + 4, at : at + 4] = [value, 0, 0, 255]
    return picture


@pytest.mark.parametrize("background", [None, (0.2, 0.4, 0.6)])
def test_pixels_are_visible_that_differ_from_the_background(
    tmp_path: Path, background: tuple[float, float, float] | None
) -> None:
    picture = np.zeros((16, 16, 4), np.uint8)
    picture[2:4, 3:6] = [10, 0, 0, 40]
    picture[5, 5] = [1, 1, 1, 2]  # less than a hundredth
    if background:
        picture[..., :3] += np.round(255.0 * np.array(background)).astype(np.uint8)
        picture[..., 3] = 255
    catalog = catalog_of(tmp_path, [[(0, picture)]], background)
    source = Source(TrainingSettings(), catalog)
    assert visible_pixels(source, sampled(source, training_rows(catalog, [source.appearance]))) == 6.0


@pytest.mark.parametrize("background", [None, (0.2, 0.4, 0.6)])
def test_pictures_are_rough_whose_neighbouring_pixels_differ(
    tmp_path: Path, background: tuple[float, float, float] | None
) -> None:
    def rough(name: str, *pictures: NDArray[np.uint8]) -> float:
        catalog = catalog_of(tmp_path / name, [list(enumerate(pictures))], background)
        source = Source(TrainingSettings(), catalog)
        return roughness(sampled(source, training_rows(catalog, [source.appearance])))

    x, y = np.meshgrid(np.arange(16), np.arange(16))
    board, ramp, flat = (np.full((16, 16, 4), 255, np.uint8) for _ in range(3))
    board[..., :3] = 255 * ((x + y) % 2)[..., None]
    ramp[..., :3] = (9 * x + 7 * y)[..., None]
    flat[..., :3] = 90
    inner = (14 / 16) ** 2
    assert rough("board", board) == pytest.approx(4.0 * inner)  # twice the deviation, but at the border
    assert rough("ramp", ramp) == pytest.approx(0.0, abs=1e-12)
    assert rough("flat", flat) == 0.0
    weight = 0.25 / (0.25 + float((ramp[..., 0] / 255.0).var()))
    assert rough("both", board, ramp) == pytest.approx(4.0 * inner * weight)


@pytest.mark.parametrize("background", [None, (0.2, 0.4, 0.6)])
def test_the_share_that_changes_is_that_of_the_variance(
    tmp_path: Path, background: tuple[float, float, float] | None
) -> None:
    def member(at: int) -> Pictures:
        return [(0, square(at, background=background)), (1, square(8, background=background))]

    assert share(catalog_of(tmp_path / "same", [member(2)] * 3, background)) == 0.0
    # Through camera 0 each of two squares is there or not: their mean is flat.  Through camera 1 nothing changes.
    assert share(catalog_of(tmp_path / "moved", [member(2), member(8)], background)) == pytest.approx(0.5)


def test_members_are_compared_through_the_same_camera_only(tmp_path: Path) -> None:
    assert share(catalog_of(tmp_path / "apart", [[(0, square(2))], [(1, square(8))]])) == 1.0
    shifted: list[Pictures] = [[(0, square(2)), (1, square(8))], [(1, square(8)), (0, square(2))]]
    assert share(catalog_of(tmp_path / "shifted", shifted)) == 0.0


def test_a_member_alone_and_empty_pictures_have_a_share(tmp_path: Path) -> None:
    assert share(catalog_of(tmp_path / "alone", [[(0, square(2)), (1, square(2))]])) == 1.0
    empty = np.zeros((16, 16, 4), np.uint8)
    assert share(catalog_of(tmp_path / "empty", [[(0, empty)], [(0, empty)]])) == 0.0
