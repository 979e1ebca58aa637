"""The value of several samples a pixel is measured with surfaces, and refused without."""

from __future__ import annotations

from pathlib import Path

import pytest

from research.benchmarks.training.samples import COLUMNS, rows
from surrogate.lighting import Lighting
from tests.support.field_blobs import field_catalog

MEMBERS = (("train", 0.0), ("train", 1.0), ("test", 0.5))


def test_each_number_of_samples_is_fitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "field.cdb"
    field_catalog(path, members=MEMBERS, view_splits=("train", "train", "test"), summaries=True)
    with pytest.raises(ValueError, match=r"field\.cdb has no test member with isosurfaces whose light it knows"):
        rows(path, [1], 60, 2, lambda _: None)
    monkeypatch.setattr(Lighting, "explains", lambda *_: True)
    said: list[str] = []
    found = rows(path, [1, 3], 60, 40, said.append)
    assert [row[1] for row in found] == ["1", "9"]
    assert {len(row) for row in found} == {len(COLUMNS)}
    assert len(said) == 2
    for row in found:
        assert all(5.0 < float(number) < 60.0 for number in row[2:4])
    assert found[0][2:4] != found[1][2:4]
