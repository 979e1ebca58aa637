"""Missing and packed values: of every container what the format's own library reads, masked where it masks."""

from __future__ import annotations

import asyncio
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from insitu.readers.files import read_data, read_field
from insitu.readers.missing import DEFAULT_FILLS, decoded

netCDF4 = pytest.importorskip("netCDF4")
xarray = pytest.importorskip("xarray")

SHAPE = (3, 4, 5)
CLASSIC = ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA")
FORMATS = (*CLASSIC, "NETCDF4", "NETCDF4_CLASSIC")
PACKED = {"scale_factor": 0.01, "add_offset": 10.0}
SINGLE = {"scale_factor": np.float32(0.5)}
# Attributes by name, with the type of the values that they go with.
ATTRIBUTES: dict[str, tuple[str, dict[str, Any]]] = {
    "nothing": ("f4", {}),
    "fill": ("f4", {"_FillValue": np.float32(-9.9)}),
    "nan": ("f4", {"_FillValue": np.float32(np.nan)}),
    "missing": ("f8", {"missing_value": -9.9}),
    "several": ("i4", {"missing_value": np.array([3, 5], "i4")}),
    "both": ("i2", {"missing_value": np.int16(3), "_FillValue": np.int16(5)}),
    "range": ("i2", {"valid_range": np.array([2, 7], "i2"), **PACKED}),
    "least": ("f4", {"valid_min": np.float32(2.5)}),
    "most": ("f8", {"valid_max": 6.5}),
    "range first": ("i4", {"valid_range": np.array([2, 7], "i4"), "valid_min": np.int32(4)}),
    "packed fill": ("i2", {"_FillValue": np.int16(4), **PACKED}),
    "packed single": ("i2", {"_FillValue": np.int16(4), **SINGLE}),
    "packed int": ("i4", {"add_offset": np.float32(3.0), **SINGLE}),
    "offset": ("i2", {"add_offset": np.float32(3.0)}),
    "bytes": ("i1", {}),
    "bytes fill": ("i1", {"_FillValue": np.int8(4)}),
    "unsigned": ("i2", {"_Unsigned": "true", "valid_max": np.int16(-100), "_FillValue": np.int16(-3)}),
    "unsigned packed": ("i1", {"_Unsigned": "true", **PACKED}),
    "whole as float": ("i2", {"missing_value": 4.0}),
    "unfit fill": ("f4", {"missing_value": 0.1}),
    "unfit range": ("i2", {"valid_range": np.array([1.5, 4.5])}),
}


def stored(kind: str, fill: Any = None) -> np.ndarray:
    """Values 0 to 7, with what attributes and types make of some."""
    values = np.resize(np.arange(8), SHAPE).astype(kind)
    values[0, 0, :2] = DEFAULT_FILLS[kind] if fill is None else fill
    values[0, 1, :3] = np.array([-3, -99, -101]).astype(kind)
    if kind[0] == "f":
        values[0, 2, :3] = np.array([np.nan, -9.9, 0.1]).astype(kind)
    return values


def write(path: Path, kind: str, attrs: dict[str, Any], form: str) -> Any:
    """A file of the netCDF library; its own reading, NaN where it masks."""
    with netCDF4.Dataset(path, "w", format=form) as file:
        for name, size in zip("zyx", SHAPE, strict=True):
            file.createDimension(name, size)
            file.createVariable(name, "f8", (name,))[:] = np.arange(size)
        held = file.createVariable("t", kind, ("z", "y", "x"), fill_value=attrs.get("_FillValue"))
        held.setncatts({key: value for key, value in attrs.items() if key != "_FillValue"})
        held.set_auto_maskandscale(False)
        held[:] = stored(kind)
    with netCDF4.Dataset(path) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.ma.filled(file["t"][:].astype(np.float64), np.nan)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("case", ATTRIBUTES)
@pytest.mark.filterwarnings("ignore:t. .* does not fit")
def test_netcdf_is_read_as_its_library_does(tmp_path: Path, case: str, form: str) -> None:
    kind, attrs = ATTRIBUTES[case]
    truth = write(tmp_path / "a.nc", kind, attrs, form)
    values = read_data(tmp_path / "a.nc").values
    assert np.array_equal(np.isnan(values), np.isnan(truth))
    assert np.allclose(values, truth, rtol=1e-6, equal_nan=True)


@pytest.mark.parametrize("form", FORMATS)
def test_what_was_never_written_is_a_hole(tmp_path: Path, form: str) -> None:
    for kind in sorted(set(DEFAULT_FILLS) if form == "NETCDF4" else {"i1", "i2", "i4", "f4", "f8"}):
        path = tmp_path / f"{kind}.nc"
        with netCDF4.Dataset(path, "w", format=form) as file:
            for name, size in zip("zyx", SHAPE, strict=True):
                file.createDimension(name, size)
                file.createVariable(name, "f8", (name,))[:] = np.arange(size)
            file.createVariable("t", kind, ("z", "y", "x"))[:2] = 1
        with netCDF4.Dataset(path) as file:
            masked = np.ma.getmaskarray(file["t"][:])
        grid = read_field(path, nan="transparent")
        assert masked.sum() == 20
        assert np.array_equal(grid.holes, masked)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    "encoding",
    [{"_FillValue": -9.9}, {"dtype": "i2", "_FillValue": -1, "scale_factor": 0.25, "add_offset": 1.0}, {"dtype": "f4"}],
)
def test_zarr_is_read_as_xarray_does(tmp_path: Path, version: int, encoding: dict[str, Any]) -> None:
    pytest.importorskip("zarr")
    values = np.resize(np.arange(8.0), SHAPE)
    values[0, 0] = np.nan
    array = xarray.DataArray(
        values, dims=("z", "y", "x"), coords={n: np.arange(float(s)) for n, s in zip("zyx", SHAPE, strict=True)}
    )
    path = tmp_path / "a.zarr"
    array.to_dataset(name="t").to_zarr(path, zarr_format=version, encoding={"t": encoding}, consolidated=False)
    truth = xarray.open_zarr(path, consolidated=False)["t"].values
    assert np.isnan(truth).sum() == 5
    assert np.array_equal(read_data(path).values, truth, equal_nan=True)


@pytest.mark.parametrize("version", [2, 3])
def test_plain_zarr_has_the_values_of_its_library(tmp_path: Path, version: int) -> None:
    """The fill value of plain Zarr is a value, and so is netCDF's default."""
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w", zarr_format=version)
    held = group.create_array("t", shape=SHAPE, dtype="f4", chunks=(1, 4, 5), fill_value=3.0)
    held[:2] = 1.0
    held[0, 0, 0] = DEFAULT_FILLS["f4"]
    group.attrs["spacing"] = [1.0, 1.0, 1.0]
    assert np.array_equal(read_data(tmp_path / "a.zarr").values, held[:])
    with ThreadPoolExecutor(1) as thread:  # the browser's tests run a loop in the main one
        values = thread.submit(asyncio.run, read_in_a_notebook(tmp_path / "a.zarr")).result()
    assert np.array_equal(values, held[:])


async def read_in_a_notebook(path: Path) -> np.ndarray:
    """The values as a cell of a notebook reads them, whose event loop runs."""
    return read_data(path).values


def test_plain_hdf5_is_unpacked_by_attributes_and_has_no_default(tmp_path: Path) -> None:
    values = stored("i2")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = values
        file["t"].attrs.update({"_FillValue": np.int16(4), "scale_factor": [0.5], "add_offset": [1.0]})
        file.attrs["spacing"] = [1.0, 1.0, 1.0]
    expected = np.where(values == 4, np.nan, values * 0.5 + 1.0)
    assert np.array_equal(read_data(tmp_path / "a.h5").values, expected, equal_nan=True)


@pytest.mark.parametrize("kind", [">f4", ">f8", "f2", ">i2", ">i4", "i8", "u1", "u2"])
def test_every_real_type_and_byte_order_of_hdf5_is_read(tmp_path: Path, kind: str) -> None:
    values = np.resize(np.arange(100), SHAPE).astype(kind)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = values
        file.attrs["spacing"] = [1.0, 1.0, 1.0]
    grid = read_field(tmp_path / "a.h5")
    assert grid.values.dtype.isnative
    assert np.array_equal(grid.values, values.astype(np.float64))


@pytest.mark.parametrize("kind", ["c8", "S3", [("re", "f4"), ("im", "f4")]])
def test_other_types_are_refused_by_name(tmp_path: Path, kind: Any) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = np.zeros(SHAPE, kind)
        file.attrs["spacing"] = [1.0, 1.0, 1.0]
    for array in (None, "t"):
        with pytest.raises(ValueError, match=r"a\.h5: array .t. must hold real numbers.*\(3, 4, 5\)"):
            read_field(tmp_path / "a.h5", array=array)


def test_packed_coordinates_are_unpacked_and_holes_in_them_refused(tmp_path: Path) -> None:
    for hole in (False, True):
        path = tmp_path / f"{hole}.nc"
        with netCDF4.Dataset(path, "w") as file:
            for name, size in zip("zyx", SHAPE, strict=True):
                file.createDimension(name, size)
                held = file.createVariable(name, "i2", (name,), fill_value=-1)
                held.scale_factor, held.add_offset = 0.5, 3.0
                held[: size - hole] = 3.0 + np.arange(size - hole)
            file.createVariable("t", "f4", ("z", "y", "x"))[:] = 1.0
        if hole:
            with pytest.raises(ValueError, match="coordinates along 'x' must be finite"):
                read_field(path)
        else:
            grid = read_field(path)
            assert (grid.spacing, grid.origin) == ((1.0, 1.0, 1.0), (3.0, 3.0, 3.0))


def test_an_attribute_that_marks_nothing_is_told() -> None:
    with pytest.warns(UserWarning, match=r"t: valid_max 4\.5 does not fit int16"):
        assert decoded(np.arange(9, dtype="i2"), {"valid_max": 4.5}, "t").dtype == np.int16


def test_arrays_of_other_types_do_not_hide_the_field(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as file:
        for name, size in zip("zyx", SHAPE, strict=True):
            file.createDimension(name, size)
            file.createVariable(name, "f8", (name,))[:] = np.arange(size)
        file.createVariable("t", "f4", ("z", "y", "x"))[:] = 1.5
        pair = file.createCompoundType(np.dtype([("re", "f4"), ("im", "f4")]), "pair")
        file.createVariable("compound", pair, ("z", "y", "x"))
        file.createVariable("ragged", file.createVLType("f4", "row"), ("z",))[0] = np.arange(3, dtype="f4")
        file.createVariable("word", str, ("z",))[:] = np.array(["a", "b", "c"], object)
    assert (read_data(tmp_path / "a.nc").values == 1.5).all()
    with pytest.raises(ValueError, match=r"array 'compound' must hold real numbers"):
        read_data(tmp_path / "a.nc", array="compound")


@pytest.mark.parametrize("attribute", ["0.1", [0.5, 1.0], b"a"])
@pytest.mark.parametrize("key", ["scale_factor", "add_offset"])
def test_packing_by_anything_but_one_number_is_refused(key: str, attribute: Any) -> None:
    with pytest.raises(ValueError, match=f"t: {key} must be one number, got"):
        decoded(np.arange(4, dtype=np.int16), {key: attribute}, "t")
