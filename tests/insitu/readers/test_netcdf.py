"""Headers of classic netCDF files, against what the netCDF library says of the files that it wrote."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insitu.readers.arrays import open_classic
from insitu.readers.netcdf import is_classic, read_header
from tests.support.damage import damaged, memory_at_most

netCDF4 = pytest.importorskip("netCDF4", reason="netCDF4 is not installed: pip install 'gs-surrogate[mpas]'")
FORMS = {"NETCDF3_CLASSIC": 1, "NETCDF3_64BIT_OFFSET": 2, "NETCDF3_64BIT_DATA": 5}
KINDS = {1: ["i1", "S1", "i2", "i4", "f4", "f8"], 5: ["i1", "S1", "i2", "i4", "f4", "f8", "u1", "u2", "u4", "i8", "u8"]}


def write(path: Path, form: str, records: int = 3, kinds: list[str] | None = None) -> None:
    with netCDF4.Dataset(path, "w", format=form) as file:
        file.title = "a file of odd sizes"
        file.numbers = np.arange(3, dtype="i2")
        for name, size in (("t", None), ("x", 5), ("odd_name", 3)):
            file.createDimension(name, size)
        for kind in kinds or KINDS.get(FORMS[form], KINDS[1]):
            held = file.createVariable(f"fixed_{kind}", kind, ("odd_name", "x"))
            held.units = "m"
            held[:] = np.ones((3, 5)).astype(kind)
            if records:
                file.createVariable(f"record_{kind}", kind, ("t", "odd_name"))[:] = np.ones((records, 3)).astype(kind)


@pytest.mark.parametrize("records", [0, 1, 3])
@pytest.mark.parametrize("form", FORMS)
def test_the_header_says_what_the_library_says(tmp_path: Path, form: str, records: int) -> None:
    path = tmp_path / "a.nc"
    write(path, form, records)
    header = read_header(path)
    with netCDF4.Dataset(path) as file:
        assert header.dimensions == {name: len(held) for name, held in file.dimensions.items()}
        assert header.variables == {name: held.dimensions for name, held in file.variables.items()}
        with open_classic(path) as arrays:
            for name, held in file.variables.items():
                assert np.array_equal(arrays.arrays[name].read(), held[...])
            assert arrays.attrs[""]["title"] == "a file of odd sizes"


def test_a_single_variable_with_records_is_not_padded(tmp_path: Path) -> None:
    for form in FORMS:
        write(tmp_path / "a.nc", form, 7, ["i1"])
        assert read_header(tmp_path / "a.nc").dimensions["t"] == 7


@pytest.mark.parametrize("form", FORMS)
def test_every_byte_that_is_missing_at_the_end_is_missed(tmp_path: Path, form: str) -> None:
    path = tmp_path / "a.nc"
    write(path, form, kinds=["f8", "i2"])
    data = path.read_bytes()
    for cut in (8, 100, len(data) - 40):  # bytes that pad the end do not matter
        path.write_bytes(data[:-cut])
        with pytest.raises(ValueError, match=r"the file has|than the file holds|more than it holds"):
            read_header(path)


def test_other_files_are_no_classic_ones(tmp_path: Path) -> None:
    for number, data in enumerate((b"", b"CDF", b"CDF\3", b"CDF\4abc", b"\x89HDF\r\n", b"CDF\1")):
        path = tmp_path / str(number)
        path.write_bytes(data)
        assert is_classic(path) == (data == b"CDF\1")
        with pytest.raises(ValueError, match=r"classic netCDF|than the file holds"):
            read_header(path)
    assert not is_classic(tmp_path)
    assert not is_classic(tmp_path / "absent")


@settings(max_examples=100)
@given(st.sampled_from(sorted(FORMS)), st.data())
def test_what_passes_the_check_the_library_can_read(form: str, data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "a.nc")
        write(path, form)
        path.write_bytes(data.draw(damaged(path.read_bytes())))
        with memory_at_most(4 << 20):
            try:
                header = read_header(path)
            except ValueError as error:
                assert "\n" not in str(error)  # noqa: PT017 - or none
                return
        try:
            with open_classic(path) as arrays:
                shapes = {n: array.read().shape for n, array in arrays.arrays.items()}
        except (OSError, ValueError, RuntimeError, UnicodeDecodeError, AttributeError):
            return
        assert set(shapes) == set(header.variables)
