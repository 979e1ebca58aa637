"""The table of emulated fields is that of a scene's source."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.store.coarse import CoarseField
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import Scene
from research.benchmarks.emulation.unseen import HEADER, Known, known_fields, row
from tests.support.ensembles_of_fields import ORIGIN, SPACING, smooth, some_points

SPACE = ParameterSpace((Parameter("a", -1.0, 1.0), Parameter("b", -1.0, 1.0)))
VOLUME = VolumeRendering(
    "dvr", TransferFunction(((8.0, 0.0, 0.0, 1.0), (12.0, 1.0, 1.0, 0.0)), ((8.0, 0.0), (12.0, 0.6)), 0.3)
)


def members(split: str, count: int, seed: int) -> list[Known]:
    points = some_points(count, seed=seed)
    fields = (CoarseField(values, SPACING, ORIGIN, whole=True) for values in smooth(points))
    return [Known(point, split, field) for point, field in zip(points, fields, strict=True)]


def test_a_row_has_the_cells_of_the_header() -> None:
    cells = row("waves", SPACE, members("train", 24, 0) + members("test", 4, 1), VOLUME, 2)
    assert len(cells) == len(HEADER)
    assert cells[:3] == ["`waves`", "24, 4 unseen", "12 x 10 x 8"]
    mean, worst = map(float, cells[7].split(" / "))
    assert mean >= worst > 30.0
    assert float(cells[8].split(" / ")[1]) < 0.05


def test_a_scene_without_test_members_is_named() -> None:
    with pytest.raises(ValueError, match="waves has no test members"):
        row("waves", SPACE, members("train", 4, 0), VOLUME, 2)


def test_fields_are_those_of_the_source_where_there_is_no_catalog(tmp_path: Path) -> None:
    scene = Scene.load("scenes/tiny.toml")
    space, found = known_fields(scene, tmp_path, scene.appearances[0])
    assert len(found) == len(scene.members)
    assert space.names == scene.space.names
    assert all(np.isfinite(member.field.values).all() for member in found)
