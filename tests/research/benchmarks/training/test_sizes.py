"""The same members are rendered at every size, once, and each size's surrogate is scored on its own images."""

from __future__ import annotations

from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.scene import Scene
from research.benchmarks.training.sizes import HEADER, render, row, trained
from tests.support.environments import with_settings


@pytest.mark.slow
def test_members_are_rendered_once_at_each_size_and_scored(tmp_path: Path) -> None:
    few = {"resolution = 32": "resolution = 16"}
    scene = Scene.load(with_settings("tiny", tmp_path, few))
    said: list[str] = []
    for _ in range(2):
        render(scene, tmp_path, [16, 24], 1, said.append)
    assert len(said) == 7  # members: the second time all are there
    catalogs = {size: Catalog.open(tmp_path / f"{size}.cdb") for size in (16, 24)}
    assert {size: c.plan.cameras[0].width for size, c in catalogs.items()} == {16: 16, 24: 24}
    assert [m.parameters for m in catalogs[16].members] == [m.parameters for m in catalogs[24].members]
    words = ["gaussians=100", "canonical_steps=0", "deformation_steps=40"]
    cells = row(16, catalogs[16], trained(catalogs[16], tmp_path / "run", words), 200)
    assert len(cells) == len(HEADER)
    assert cells[0] == "16²"
    assert float(cells[4]) > 35.0  # a field of 16³ is stored whole
    assert all(0.1 < float(cell) < 200.0 for cell in cells[6:])
