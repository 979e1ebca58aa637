"""The benchmark of layouts runs, and says of both what it promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from click.testing import CliRunner

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.vocabulary.appearance import ImportedImages
from research.benchmarks.stores.packing import main
from tests.support.blobs import Blobs


def test_both_layouts_are_measured(tmp_path: Path) -> None:
    blobs = Blobs()
    cameras = blobs.cameras()[:4]
    plan = CatalogPlan(
        blobs.space, (ImportedImages("drawn"),), cameras, ("train", "train", "train", "test"), blobs.bounds
    )
    catalog = Catalog.create(tmp_path / "blobs.cdb", plan)
    for p in (0.0, 1.0):
        with catalog.begin_member(f"member-{p:g}", {"p": p}) as writer:
            for view, camera in enumerate(cameras):
                writer.write_image("drawn", view, blobs.picture(p, camera).astype(np.float32))
    arguments = [str(catalog.path), "--rounds", "1", "--steps", "0", "--folder", str(tmp_path)]
    result = CliRunner().invoke(main, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert " folder: " in result.output
    assert " packed: " in result.output
    assert "the same fingerprint: True" in result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["blobs.cdb"]
