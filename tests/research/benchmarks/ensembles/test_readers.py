"""The benchmark of readers: ours and the library's give the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insitu.readers.codes import OURS
from insitu.readers.files import read_data
from research.benchmarks.ensembles.readers import CODES, read

LIBRARIES = {"cloverleaf": "pyvista", "mpas": "netCDF4", "store": "netCDF4", "adios2": "adios2"}


def test_every_reader_is_measured() -> None:
    assert sorted([*CODES, "vtk"]) == sorted(reader.name for reader in OURS)  # pyvista reads for "vtk"


@pytest.mark.parametrize("code", sorted(set(CODES) - {"mpas", "adios2"}))
def test_ours_and_the_librarys_values_are_the_same(tmp_path: Path, code: str) -> None:
    pytest.importorskip(LIBRARIES.get(code, "numpy"))
    known = CODES[code]
    path = known.write(tmp_path, 8)
    ours = read_data(path, array=known.array, reader=code, index=known.index).values
    theirs = np.asarray(known.read(path))
    assert np.array_equal(ours, theirs if code != "well" else theirs.T)


def test_what_is_measured_has_a_time_a_peak_and_the_same_sum(tmp_path: Path) -> None:
    path = CODES["xcompact3d"].write(tmp_path, 8)
    ours, theirs = (read("xcompact3d", path, 8, ours) for ours in (True, False))
    assert ours["total"] == pytest.approx(theirs["total"])
    assert ours["seconds"] > 0
    assert ours["peak"] >= 0
