"""The gallery: which member is shown, how its picture looks on white, and the line beneath it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from catalogs.store.catalog import Catalog
from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from research.benchmarks.results.gallery import CASES, draw, figures, gallery, on_white, shown_member
from research.benchmarks.results.scenes import SceneResults


class Named:
    def __init__(self, name: str, split: str) -> None:
        self.name, self.split = name, split


@pytest.mark.parametrize(
    ("splits", "shown"), [(["train", "test", "test", "test"], 2), (["train", "train", "train"], 1), (["test"], 0)]
)
def test_a_test_member_is_shown_where_there_is_one(splits: list[str], shown: int) -> None:
    members: list[Any] = [Named(str(i), split) for i, split in enumerate(splits)]
    assert shown_member(members).name == str(shown)


def test_without_members_there_is_nothing_to_show() -> None:
    with pytest.raises(ValueError, match="no members"):
        shown_member([])


def test_what_is_transparent_is_white() -> None:
    picture = np.zeros((32, 32, 4), np.float32)
    picture[:, :16] = (0.5, 0.0, 0.0, 0.5)  # red, half transparent
    shown = np.asarray(on_white(picture))
    assert shown.shape == (256, 256, 3)
    assert shown[128, 30].tolist() == pytest.approx([255, 128, 128], abs=1)
    assert shown[128, 220].tolist() == [255, 255, 255]


def test_a_picture_of_a_catalog_is_written(tmp_path: Path) -> None:
    cameras = tuple(orbit((0.0, 0.0, 0.0), 1.0, frequency=1, width=8, height=8))
    space, bounds = ParameterSpace((Parameter("Re", 0.0, 4.0),)), ((-1.0,) * 3, (1.0,) * 3)
    plan = CatalogPlan(space, (Isosurface("iso", 0.5),), cameras, tuple(view_splits(12)), bounds)
    made = Catalog.create(tmp_path / "a.cdb", plan)
    for split, color in (("train", (255, 0, 0, 255)), ("test", (0, 0, 255, 255))):
        with made.begin_member(split, {"Re": float(len(split)) / 2.0}, split=split) as writer:
            for view in range(12):
                writer.write_image("iso", view, np.full((8, 8, 4), color, dtype=np.uint8))
    draw(made, 3, tmp_path / "shown.png")
    with Image.open(tmp_path / "shown.png") as shown:
        assert shown.size == (256, 256)
        assert shown.getpixel((100, 100)) == (0, 0, 255)


def test_a_scene_that_was_not_measured_says_so() -> None:
    assert figures(SceneResults("a", "A", Path("runs/a"))) == "not measured yet"
    unmeasured = [SceneResults(case.scene, case.scene, Path("runs")) for case in CASES]
    header, _, pictures, what, lines = gallery(unmeasured).splitlines()
    assert lines.count("not measured yet") == len(CASES)
    assert all(f"gallery_{case.scene}.png" in pictures and case.scene in header and case.what in what for case in CASES)
