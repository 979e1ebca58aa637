"""Exported files are read back unchanged."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from catalogs.exchange import ExchangeError, export, import_nerf
from catalogs.store.catalog import Catalog
from tests.catalogs.conftest import add_member, make_plan


def test_a_catalog_comes_back(catalog: Catalog, tmp_path: Path) -> None:
    add_member(catalog, "third", 150.0, split="validation", seed=3)
    data = export(catalog, tmp_path / "data", "nerf", appearance="dvr")
    bounds = catalog.plan.bounds
    back = import_nerf(
        data, tmp_path / "back.cdb", bounds=bounds, background=None, space=catalog.plan.space, validation_members=1
    )
    found = {tuple(member.parameters.values()): member for member in back.members}
    assert len(found) == 3
    for member in catalog.members:
        same = found[tuple(member.parameters.values())]
        assert same.split == member.split
        assert len(same.cameras) == len(member.cameras)
        for view, camera in enumerate(member.cameras):
            place = next(
                n for n, p in enumerate(same.provenance["pictures"]) if p.endswith(f"{member.name}_{view:03d}.png")
            )
            back_camera = same.cameras[place]
            np.testing.assert_allclose(back_camera.world_to_camera, camera.world_to_camera, atol=1e-12)
            assert back_camera.fx == pytest.approx(camera.fx, rel=1e-12)
            np.testing.assert_array_equal(back.image(same, "imported", place), catalog.image(member, "dvr", view))
            if member.split != "test":
                assert same.view_splits[place] == member.view_splits[view]


def test_lenses_that_one_angle_cannot_say_are_refused(tmp_path: Path) -> None:
    plan = make_plan()
    shifted = dataclasses.replace(plan.cameras[4], cx=7.0)
    made = Catalog.create(tmp_path / "odd.cdb", make_plan(cameras=(*plan.cameras[:4], shifted, *plan.cameras[5:])))
    add_member(made, "first", 120.0)
    with pytest.raises(ExchangeError, match="view 4 of member first"):
        export(made, tmp_path / "data", "nerf", appearance="dvr")
