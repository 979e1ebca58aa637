"""The benchmark of training in batches and in several processes runs, and writes its tables."""

from __future__ import annotations

from pathlib import Path

import pytest

from research.benchmarks.training.ranks import main, settings_of
from tests.support.blobs import Blobs, stored
from tests.support.ranks import require_gloo


def test_all_batches_see_as_many_images_and_only_their_steps_differ() -> None:
    one, four = settings_of(1, 400), settings_of(4, 400)
    assert one.canonical_steps + one.deformation_steps == 400
    assert (four.canonical_steps, four.deformation_steps) == (20, 80)
    assert four.changed(batch=1, canonical_steps=80, deformation_steps=320) == one


@pytest.mark.slow
def test_it_runs(tmp_path: Path) -> None:
    require_gloo()
    members = (("train", 0.0), ("train", 0.5), ("test", 0.7), ("train", 1.0))
    catalog = stored(tmp_path / "blobs.cdb", Blobs(count=4, size=16), members=members)
    main([str(catalog.path), "--quick", "--machine", "a test's", "--output", str(tmp_path)], lambda _: None)
    page = (tmp_path / "clusters.md").read_text()
    for text in (
        "| 2 | 20 | ",
        "| 2,000 | 2 | 2 | ",
        f"`python -m research.benchmarks.training.ranks {catalog.path}`",
    ):
        assert text in page
