"""Tiles are what the whole picture shows there, and every way is trained and judged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from research.benchmarks.training.step_pixels import HEADER, Way, rows, tiles
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.data import Example
from tests.support.blobs import Blobs, stored

MEMBERS = [("train", 0.2), ("train", 0.8), ("validation", 0.4)]
SMALL = TrainingSettings(gaussians=200)


def example(width: int, height: int) -> Example:
    camera = Camera.look_at((0.5, -4, 1), (0, 0, 0), vertical_fov_degrees=30, width=width, height=height)
    pixels = np.random.default_rng(0).integers(0, 255, (height, width, 4), dtype=np.uint8)
    return Example(camera, torch.zeros(1), pixels, "a")


@pytest.mark.parametrize("parts", [1, 2, 4])
def test_tiles_show_each_pixel_once(parts: int) -> None:
    whole = example(24, 16)
    images = [tile.pixels for tile in tiles(whole, parts)]
    lines = [np.hstack(images[line * parts : (line + 1) * parts]) for line in range(parts)]
    assert (np.vstack(lines) == whole.pixels).all()


@pytest.mark.parametrize("parts", [2, 4])
def test_cameras_of_tiles_draw_the_whole_picture(parts: int) -> None:
    generator = torch.Generator().manual_seed(0)
    count = 60
    gaussians = Gaussians(
        means=torch.rand(count, 3, generator=generator) * 1.6 - 0.8,
        log_scales=torch.full((count, 3), -2.0),
        quats=torch.nn.functional.normalize(torch.randn(count, 4, generator=generator)),
        opacity_logits=torch.zeros(count),
        colors=torch.rand(count, 3, generator=generator),
    )
    whole, rasterizer = example(32, 32), Rasterizer.of(SMALL)
    drawn = [rasterizer.draw_over(gaussians, t.camera, (1.0, 1.0, 1.0)).numpy() for t in tiles(whole, parts)]
    lines = [np.hstack(drawn[line * parts : (line + 1) * parts]) for line in range(parts)]
    expected = rasterizer.draw_over(gaussians, whole.camera, (1.0, 1.0, 1.0)).numpy()
    np.testing.assert_allclose(np.vstack(lines), expected, atol=1e-2)  # cut-offs move with the pixels that are drawn


def test_unequal_parts_are_refused() -> None:
    with pytest.raises(ValueError, match="no 3 equal parts"):
        list(tiles(example(16, 16), 3))


@pytest.mark.slow
def test_every_way_has_its_row(tmp_path: Path) -> None:
    catalog = stored(tmp_path / "blobs.cdb", Blobs(count=4, size=16), members=MEMBERS)
    table = list(rows(catalog.path, SMALL, 0.2, (Way(), Way(downsampling=2), Way(parts=2), Way(batch=2))))
    assert [line[0] for line in table] == [
        "a picture",
        "a picture, 1/2 as wide first",
        "1/4 of a picture",
        "2 times a picture",
    ]
    assert {len(line) for line in table} == {len(HEADER)}
    assert [line[3] for line in table] == ["256", "122", "64", "512"]
    assert all(10.0 < float(line[5]) < 60.0 for line in table)


def test_nothing_to_judge_by_is_refused(tmp_path: Path) -> None:
    catalog = stored(tmp_path / "blobs.cdb", Blobs(count=4, size=16), members=MEMBERS)
    with pytest.raises(ValueError, match="no validation images"):
        list(rows(catalog.path, replace(SMALL, validation_images=0), 0.1, (Way(),)))
