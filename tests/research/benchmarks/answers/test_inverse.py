"""The inverse's benchmark: intervals of members that others calibrate, on an ensemble of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from research.benchmarks.answers import blobs, inverse
from surrogate.model import Surrogate
from surrogate.model.judged import judged


def test_fields_of_the_ensemble_follow_two_parameters_where_they_are_seen() -> None:
    opaque = blobs.FUNCTION.opacity_points[1][0]
    first, second = (blobs.field_at(0.2, 0.2, hidden) for hidden in (0.0, 1.0))
    assert not np.array_equal(first, second)
    assert np.array_equal(first[first > opaque], second[second > opaque])
    assert not np.array_equal(first > opaque, blobs.field_at(0.8, 0.2, 0.0) > opaque)


@pytest.mark.slow
def test_intervals_hold_for_members_that_others_calibrate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blobs, "MEMBERS", {"train": 16, "validation": 3, "test": 2})
    monkeypatch.setattr(inverse, "FACTORS", 2)
    blobs.main([str(tmp_path / "run")])
    catalog = Catalog.open(tmp_path / "run" / "catalog.cdb")
    surrogate = judged(Surrogate.load(tmp_path / "run" / "surrogate"), catalog)
    rows = inverse.rows_of("blobs", surrogate, catalog, 1)
    assert [row[2] for row in rows] == list(blobs.SPACE.names)
    widths = [float(row[4].rstrip("%")) for row in rows]
    assert widths[0] < 40.0 < widths[2]
