"""CF's auxiliary variables: bounds, cell measures, terms of formulas and mappings are neither parameters nor fields."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insitu.readers.arrays import open_arrays
from insitu.readers.attributes import auxiliaries
from insitu.readers.files import read_data
from insitu.readers.stored import StoredEnsemble

netCDF4 = pytest.importorskip("netCDF4")
pytest.importorskip("xarray")

SIZES = {"time_counter": None, "lev": 6, "lat": 8, "lon": 10, "bnds": 2}


def create(path: Path, sizes: dict[str, int | None], arrays: dict[str, tuple[str, Any, dict[str, Any]]]) -> None:
    """A file of arrays by name: (names of the axes, values, attributes)."""
    with netCDF4.Dataset(path, "w") as file:
        for name, size in sizes.items():
            file.createDimension(name, size)
        for name, (dims, values, attrs) in arrays.items():
            held = file.createVariable(name, np.asarray(values).dtype, tuple(dims.split()))
            held.setncatts(attrs)
            held[...] = values


def pairs(count: int) -> np.ndarray:
    return np.stack([np.arange(count) - 0.5, np.arange(count) + 0.5], axis=1)


def cmip(times: int = 4, attribute: str = "bounds", name: str = "time_bnds") -> dict[str, Any]:
    """A monthly field, with bounds of every axis and the area of its cells."""
    random = np.random.default_rng(0)
    values = random.random((times, 6, 8, 10)).astype("f4")
    about = {"units": "days since 2000-01-01", attribute: name}
    return {
        "time": ("time", np.arange(times) * 30.0 + 15, about),
        name: ("time bnds", 30 * pairs(times), {"long_name": "time bounds"}),
        "lev": ("lev", np.arange(6.0), {}),
        "lat": ("lat", np.arange(8.0), {"bounds": "lat_bnds"}),
        "lat_bnds": ("lat bnds", pairs(8), {}),
        "lon": ("lon", np.arange(10.0), {"bounds": "lon_bnds"}),
        "lon_bnds": ("lon bnds", pairs(10), {}),
        "crs": ("", np.int32(0), {"grid_mapping_name": "latitude_longitude"}),
        "volume": ("lev lat lon", random.random((6, 8, 10)), {}),
        "quality": ("time lev lat lon", np.ones((times, 6, 8, 10), "i4"), {}),
        "thetao": (
            "time lev lat lon",
            values,
            {"cell_measures": "volume: volume", "grid_mapping": "crs", "ancillary_variables": "quality"},
        ),
    }


def nemo() -> dict[str, Any]:
    """XIOS's own times, and the corners of curved cells."""
    about = {"units": "seconds since 1900-01-01", "bounds": "time_counter_bounds"}
    return {
        "time_counter": ("time_counter", np.array([15.0, 45.0, 75.0]), {**about, "standard_name": "time"}),
        "time_counter_bounds": ("time_counter bnds", pairs(3), {}),
        "time_centered": ("time_counter", np.array([16.0, 46.0, 76.0]), {"units": "seconds since 1900-01-01"}),
        "deptht": ("lev", np.arange(6.0), {"positive": "down"}),
        "nav_lat": ("lat lon", np.zeros((8, 10)), {"bounds": "bounds_lat"}),
        "bounds_lat": ("lat lon bnds", np.zeros((8, 10, 2)), {}),
        "votemper": (
            "time_counter lev lat lon",
            np.random.default_rng(0).random((3, 6, 8, 10)),
            {"coordinates": "nav_lat"},
        ),
    }


def roms() -> dict[str, Any]:
    """Depths of terrain-following levels, which change with time."""
    return {
        "time": ("time", np.array([15.0, 45.0, 75.0]), {}),
        "lev": ("lev", np.linspace(-1, 0, 6), {"formula_terms": "s: lev eta: zeta depth: h", "positive": "up"}),
        "zeta": ("time lat lon", np.zeros((3, 8, 10)), {}),
        "Cs_r": ("lev", np.linspace(-1, 0, 6), {}),
        "mean": ("time lat", np.zeros((3, 8)), {}),
        "kinetic": ("time", np.array([1.0, 3.0, 2.0]), {}),
        "z_rho": ("time lev lat lon", np.zeros((3, 6, 8, 10)), {}),
        "temp": ("time lev lat lon", np.random.default_rng(0).random((3, 6, 8, 10)), {"coordinates": "z_rho"}),
    }


FILES: dict[str, tuple[Callable[[], dict[str, Any]], str]] = {
    "CMIP": (cmip, "thetao"),
    "as many times as latitudes": (lambda: cmip(8), "thetao"),
    "a climatology": (lambda: cmip(4, "climatology", "climatology_bounds"), "thetao"),
    "NEMO": (nemo, "votemper"),
    "ROMS": (roms, "temp"),
}


@pytest.mark.parametrize("case", FILES)
def test_time_alone_is_the_parameter_and_the_field_is_found(tmp_path: Path, case: str) -> None:
    make, name = FILES[case]
    arrays = make()
    create(tmp_path / "a.nc", {"time": None, **SIZES}, arrays)
    opened = StoredEnsemble.open(tmp_path / "a.nc", spacing=None if case == "CMIP" else (1, 1, 1))
    time = next(key for key in ("time_counter", "time") if key in arrays)
    assert opened.fields == (name,)
    assert opened.space.names == (time,)
    assert opened.parameters == tuple((float(t),) for t in arrays[time][1])


def test_one_time_has_one_field(tmp_path: Path) -> None:
    create(tmp_path / "a.nc", {"time": None, **SIZES}, cmip(1))
    assert np.array_equal(read_data(tmp_path / "a.nc").values, cmip(1)["thetao"][1][0])
    assert np.array_equal(read_data(tmp_path / "a.nc", array="volume").values, cmip(1)["volume"][1])


def test_the_arrays_that_describe_others_are_listed(tmp_path: Path) -> None:
    create(tmp_path / "a.nc", {"time": None, **SIZES}, cmip())
    with open_arrays(tmp_path / "a.nc") as arrays:
        assert auxiliaries(arrays) == {"time_bnds", "lat_bnds", "lon_bnds", "volume", "crs", "quality"}
    create(tmp_path / "b.nc", {"time": None, **SIZES}, roms())
    with open_arrays(tmp_path / "b.nc") as arrays:
        assert auxiliaries(arrays) == {"lev", "zeta", "z_rho"}
        assert auxiliaries(arrays, but="coordinates") == {"lev", "zeta"}
