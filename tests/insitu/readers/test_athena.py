"""Athena++: blocks make one field whose values are those of their places, a coarser block's cells repeated."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings

from insitu.readers.athena import READER
from insitu.readers.codes import reader_of
from insitu.readers.files import read_data, read_field
from insitu.readers.reader import Sampling
from insitu.readers.states import dumps_below, table_of_files, with_states
from tests.support.athena_files import uniform, value, write_athena
from tests.support.damage import damaged, read_or_refused

REFINED = [block for block in uniform() if block != (0, (1, 2, 0))]
REFINED += [(1, (2 + x, 4 + y, z)) for x in (0, 1) for y in (0, 1) for z in (0, 1)]


def at(found: Any) -> Any:
    """The density at the places of a field's values."""
    x, y, z = (
        a + s * np.arange(n) for a, s, n in zip(found.origin, found.spacing, found.values.shape[::-1], strict=True)
    )
    return value(x[None, None, :], y[None, :, None], z[:, None, None])


@pytest.mark.parametrize("kind", [">f8", ">f4", "<f8"])
def test_the_blocks_make_one_field(tmp_path: Path, kind: str) -> None:
    path = write_athena(tmp_path / "a.out1.00040.athdf", uniform(), kind=kind)
    for place in (path, path.with_name(f"{path.name}.xdmf")):
        found = read_data(place, array="rho")
        assert found.values.shape == (4, 12, 8)
        assert (found.spacing, found.origin, found.time) == ((0.25, 0.5, 0.25), (-0.875, 0.25, 10.125), 0.5)
        assert np.allclose(found.values, at(found), rtol=1e-6 if kind == ">f4" else 1e-14)
    assert np.array_equal(read_data(path, array="press").values, -found.values)
    assert np.array_equal(read_data(path, array="Bcc1").values, 2 * found.values)
    with pytest.raises(ValueError, match=r"name the array to render \(--array\): the file has rho, press, Bcc1"):
        read_data(path)


def test_a_coarser_blocks_cells_are_repeated(tmp_path: Path) -> None:
    found = read_data(write_athena(tmp_path / "a.athdf", REFINED), array="rho")
    assert found.values.shape == (8, 24, 16)
    assert found.spacing == (0.125, 0.25, 0.125)
    fine = (slice(None), slice(16, None), slice(8, None))
    assert np.allclose(found.values[fine], at(found)[fine], rtol=1e-14)
    coarse = read_data(write_athena(tmp_path / "b.athdf", uniform()), array="rho").values
    expected = coarse.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    expected[fine] = found.values[fine]
    assert np.array_equal(found.values, expected)


def test_a_stretched_mesh_has_its_coordinates(tmp_path: Path) -> None:
    path = write_athena(tmp_path / "a.athdf", uniform(), faces=lambda share: share**2)
    found = read_data(path, array="rho")
    x, y, z = (found.coords[letter] for letter in "xyz")
    assert np.allclose(found.values, value(x[None, None, :], y[None, :, None], z[:, None, None]), rtol=1e-6)
    assert "unevenly spaced" in read_field(path, array="rho").notes[0]
    with pytest.raises(ValueError, match="its cells are uneven and refined"):
        read_data(write_athena(tmp_path / "b.athdf", REFINED, faces=lambda share: share**2), array="rho")


def test_outputs_are_told_apart_by_time_and_xdmf_files_are_no_others(tmp_path: Path) -> None:
    for number in range(3):
        write_athena(tmp_path / f"a.out1.{number:05d}.athdf", uniform(), time=0.25 * number, cycle=10 * number)
    table = with_states(table_of_files(dumps_below(tmp_path)), READER, Sampling())
    assert [(row.path.suffix, dict(row.parameters)) for row in table.rows] == [
        (".athdf", {"time": 0.25 * n}) for n in range(3)
    ]


def without_a_block(file: h5py.File) -> None:
    for name in ("Levels", "LogicalLocations", "x1f", "x2f", "x3f"):
        rows = file[name][1:]
        del file[name]
        file[name] = rows
    prim = file["prim"][:, 1:]
    del file["prim"]
    file["prim"] = prim


def moved(file: h5py.File) -> None:
    file["LogicalLocations"][0] = file["LogicalLocations"][1]


def linked(file: h5py.File) -> None:
    del file["prim"]
    file["prim"] = h5py.ExternalLink("other.athdf", "/prim")


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (without_a_block, "its 5 blocks do not fill the domain"),
        (moved, "its 6 blocks do not fill the domain"),
        (lambda file: file["LogicalLocations"].__setitem__((0, 0), 9), "its blocks leave the domain"),
        (lambda file: file["Levels"].__setitem__(0, 40), "on levels to 40 do not fit"),
        (lambda file: file["x2f"].__setitem__((2, 1), 5.5), "its faces along y are others in each of its blocks"),
        (
            lambda file: file["x2f"].__setitem__(slice(None), file["x2f"][()] * 2),
            "its faces along y are not those of 12",
        ),
        (lambda file: file.attrs.__setitem__("RootGridX1", [0.0, 2.0, 1.0]), "its faces along x are not those of"),
        (lambda file: file.attrs.__setitem__("RootGridSize", [8, 12, 1]), "has no third dimension"),
        (lambda file: file.attrs.__setitem__("RootGridSize", [1 << 30, 1 << 30, 4]), "GB, more than"),
        (lambda file: file.attrs.__setitem__("MeshBlockSize", [4, 4, 3]), "do not fit"),
        (lambda file: file.attrs.__setitem__("MeshBlockSize", [2, 4, 4]), "do not fill the domain"),
        (
            lambda file: file.attrs.__setitem__("Coordinates", np.bytes_("spherical_polar")),
            "its coordinates are 'spher",
        ),
        (lambda file: file.attrs.__setitem__("NumVariables", [9, 1]), "variables must have names"),
        (lambda file: file.attrs.__delitem__("Time"), "its attribute Time must be 1 finite numbers, got none"),
        (linked, "there is no data set 'prim' of numbers in it"),
    ],
)
def test_a_file_that_is_not_whole_is_one_error(tmp_path: Path, harm: Any, message: str) -> None:
    path = write_athena(tmp_path / "a.athdf", uniform())
    with h5py.File(path, "a") as file:
        harm(file)
    with pytest.raises(ValueError, match=message) as caught:
        read_data(path, array="rho")
    assert str(path) in str(caught.value)


def _bytes() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return write_athena(Path(folder, "a.athdf"), uniform()).read_bytes()


@settings(max_examples=100, deadline=None)
@given(damaged(_bytes(), head=4000))
def test_a_damaged_file_is_read_or_refused(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.athdf")
        path.write_bytes(data)
        if reader_of(path) is READER:
            found = read_or_refused(lambda: read_data(path, array="rho"), path)
            assert found is None or found.values.ndim == 3
