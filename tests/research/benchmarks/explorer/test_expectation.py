"""The report on expected errors covers every run and family that it is given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from research.benchmarks.explorer.expectation import main
from surrogate.rasterizer import Rasterizer
from tests.support.varied_blobs import varied_catalog, varied_surrogate


def test_both_tables_have_a_row_of_each_family(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    surrogate = replace(varied_surrogate(), rasterizer=Rasterizer(backend="cpu"))
    surrogate.save(tmp_path / "blobs" / "surrogate")
    varied_catalog(tmp_path / "blobs" / "catalog.cdb", surrogate)
    main([str(tmp_path / "blobs"), "--views", "1"])
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if line.startswith("| blobs")]
    assert [row[1] for row in rows] == ["volume", "isosurfaces", "base", "isosurfaces", "transfer functions"]
    assert not (tmp_path / "blobs" / "explore").exists()
