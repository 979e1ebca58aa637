"""A catalog of fewer views shares the images of the whole one, and leaves it as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import orbit
from research.benchmarks.training.few_views import spread_views, thinned
from tests.support.again import rendered, scene_file


@pytest.mark.parametrize(("count", "degrees"), [(2, 150.0), (6, 60.0), (12, 40.0)])
def test_views_are_spread_over_the_sphere(count: int, degrees: float) -> None:
    cameras, among = orbit((1.0, 2.0, 3.0), 2.0, width=8, height=8), range(1, 252, 2)
    taken = spread_views(cameras, among, count)
    assert len(set(taken)) == count
    assert set(taken) <= set(among)
    directions = np.array([cameras[view].position for view in taken]) - [1.0, 2.0, 3.0]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosines = (directions @ directions.T)[~np.eye(count, dtype=bool)]
    assert cosines.max() < np.cos(np.radians(degrees))


def test_no_more_views_are_taken_than_there_are() -> None:
    cameras = orbit((0.0, 0.0, 0.0), 1.0, width=8, height=8, frequency=1)
    assert spread_views(cameras, [1, 4, 7], 5) == [1, 4, 7]


@pytest.mark.slow
def test_views_that_are_left_out_test_and_the_catalog_stays(tmp_path: Path) -> None:
    catalog = rendered(scene_file(tmp_path), tmp_path / "runs")
    before = {path: path.read_bytes() for path in catalog.path.rglob("*") if path.is_file()}
    train = [view for view, split in enumerate(catalog.plan.view_splits) if split == "train"]
    few = thinned(catalog, tmp_path / "few.cdb", 3)
    again = Catalog.open(few.path)
    for member, own in zip(catalog.members, again.members, strict=True):
        assert own.name == member.name
        assert own.view_splits == again.plan.view_splits
        kept = [view for view, split in enumerate(own.view_splits) if split == "train"]
        assert len(kept) == 3
        assert set(kept) < set(train)
        assert [s for v, s in enumerate(own.view_splits) if v not in train] == [
            s for v, s in enumerate(member.view_splits) if v not in train
        ]
        name = member.appearances[0]
        np.testing.assert_array_equal(again.image(own, name, kept[0]), catalog.image(member, name, kept[0]))
    assert again.table().count(b"\n") == catalog.table().count(b"\n")
    assert {path: path.read_bytes() for path in catalog.path.rglob("*") if path.is_file()} == before
