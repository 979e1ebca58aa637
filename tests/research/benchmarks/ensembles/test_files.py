"""The benchmark of formats: all its files hold the same members."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insitu.ensembles.files import FileEnsemble
from insitu.fields.location import FieldLocation
from insitu.readers.tables import match_files
from render import to_grid
from research.benchmarks.ensembles.files import PATTERN, SPACING, WRITERS, blob, write


@pytest.mark.parametrize("suffix", WRITERS)
def test_formats_hold_the_same(tmp_path: Path, suffix: str) -> None:
    if suffix in ("nc", "zarr"):
        pytest.importorskip("xarray")
    megabytes = write(tmp_path, suffix, members=3, size=8)
    assert 0.001 < megabytes < 0.05
    place = {"spacing": SPACING} if suffix == "npy" else {}
    ensemble = FileEnsemble.of(match_files(PATTERN.format(suffix=suffix), tmp_path), location=FieldLocation(**place))
    members = ensemble.members()
    assert [m.parameters["width"] for m in members] == pytest.approx([0.2, 0.4, 0.6])
    grid = to_grid(ensemble.field(members[1], lambda fraction: None))
    assert np.array_equal(grid.values, blob(0.4, 8))
    assert grid.spacing == pytest.approx(SPACING)
