"""Exports are complete, and impossible ones are refused before anything is written."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.cli import main
from catalogs.exchange import ExchangeError, export
from catalogs.exchange.export import over
from catalogs.files.images import ImageError, read_image
from catalogs.store.catalog import Catalog


def test_pictures_stand_over_their_background() -> None:
    rgba = np.array([[[10, 20, 30, 255], [0, 0, 0, 0], [50, 0, 100, 128]]], dtype=np.uint8)
    found = over(rgba, (1.0, 0.0, 0.5))
    assert found.tolist() == [[[10, 20, 30, 255], [255, 0, 128, 255], [177, 0, 163 + 1, 255]]]


def test_a_command_exports_some_members(catalog: Catalog, tmp_path: Path) -> None:
    words = ["export", str(catalog.path), str(tmp_path / "out"), "--format", "colmap", "--appearance", "iso"]
    done = CliRunner().invoke(main, [*words, "--members", "second", "--background", "1,1,1"])
    assert done.exit_code == 0, done.output
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["second"]
    found = read_image(tmp_path / "out" / "second" / "images" / "005.png")
    np.testing.assert_array_equal(found, over(catalog.image("second", "iso", 5), (1.0, 1.0, 1.0)))


def test_progress_counts_pictures(catalog: Catalog, tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    export(catalog, tmp_path / "x", "nerf", appearance="dvr", progress=lambda *step: steps.append(step))
    assert steps == [(n, 24) for n in range(1, 25)]


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        ({}, "name the appearance"),
        ({"appearance": "q"}, "does not show 'q'"),
        ({"appearance": "dvr", "members": ["third"]}, "no member 'third'"),
        ({"appearance": "dvr", "members": ["second"]}, "no training images"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(
    catalog: Catalog, tmp_path: Path, asked: dict[str, Any], reason: str
) -> None:
    with pytest.raises(ValueError, match=reason):
        export(catalog, tmp_path / "new" / "out", "nerf", **asked)
    assert not (tmp_path / "new").exists()


def test_a_folder_that_is_there_is_left_alone(catalog: Catalog, tmp_path: Path) -> None:
    with pytest.raises(ExchangeError, match="exists already"):
        export(catalog, tmp_path, "nerf", appearance="dvr")


def test_a_second_background_is_refused(catalog: Catalog, tmp_path: Path) -> None:
    standing = Catalog(catalog.path, dataclasses.replace(catalog.plan, background=(1.0, 1.0, 1.0)))
    with pytest.raises(ExchangeError, match="already: omit background"):
        export(standing, tmp_path / "out", "nerf", appearance="dvr", background=(0.0, 0.0, 0.0))


def test_nothing_is_left_after_a_damaged_picture(catalog: Catalog, tmp_path: Path) -> None:
    catalog.image_path("second", "dvr", 7).write_bytes(b"no image")
    with pytest.raises(ImageError, match=r"007\.png"):
        export(catalog, tmp_path / "out" / "data", "nerf", appearance="dvr")
    assert list((tmp_path / "out").iterdir()) == []
