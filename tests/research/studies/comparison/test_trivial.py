"""Mixtures of stored pictures, on the images that methods are compared by."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from research.studies.comparison.task import ComparisonTask
from research.studies.comparison.trivial import trivial_cells
from surrogate.evaluation.metrics import score
from tests.support.blobs import Blobs
from tests.support.varied_blobs import varied_catalog, varied_surrogate

MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.25), ("test", 0.5))


def test_means_are_those_of_the_mixed_pictures(make_catalog) -> None:
    task = ComparisonTask.of(make_catalog(Blobs(count=3, size=16), members=MEMBERS))
    catalog, found = task.catalog, trivial_cells(task, ("psnr",))
    first, second = (m for m in catalog.members if m.split == "train")
    expected = []
    for case in task.cells["both"]:
        mean = sum(catalog.image(m, "drawn", case.view, dtype="float32") for m in (first, second)) / 2.0
        expected.append(score(catalog.image(case.member, "drawn", case.view), mean.astype(np.float32), None).psnr)
    assert found["mean image: both"]["psnr"] == pytest.approx(np.mean(expected), abs=1e-3)
    assert found["mean image: both"]["images"] == len(expected)
    assert "linear interpolation: unseen parameters" in found
    assert not any("novel views" in name for name in found)


def test_settings_are_mixed_too(tmp_path: Path) -> None:
    task = ComparisonTask.of(varied_catalog(tmp_path / "varied.cdb", varied_surrogate()))
    cells = {name.partition(": ")[2] for name in trivial_cells(task, ("psnr",))}
    assert "unseen isovalues" in cells
    assert cells <= set(task.cells)
