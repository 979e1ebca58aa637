"""Time as one of the last axes, and a group for each time: every time is a member with the writer's values, or refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray

from insitu.readers.files import read_data, read_field
from insitu.readers.layout import FileMapping
from insitu.readers.reader import Sampling
from insitu.readers.states import members_of
from insitu.readers.stored import StoredEnsemble
from insitu.readers.tables import match_files

COUNTS = {"z": 4, "y": 5, "x": 6}
TIMES = (0.0, 0.5, 1.0)
PLACES = {"z": np.arange(4) * 0.5, "y": np.arange(5) * 0.25, "x": np.arange(6) * 0.125}


def values(re: float, time: float) -> np.ndarray:  # [z, y, x]
    return np.random.default_rng(int(re + 100 * time)).random(tuple(COUNTS.values()))


def labelled(re: float, dims: str, time: str, attrs: dict[str, str]) -> xarray.DataArray:
    """By xarray, with time where `dims` has t, called `time`."""
    of_space = [xarray.DataArray(values(re, t), dims=tuple("zyx"), coords=PLACES) for t in TIMES]
    stacked = xarray.concat(of_space, time).assign_coords({time: (time, list(TIMES), attrs)})
    return stacked.transpose(*(time if letter == "t" else letter for letter in dims)).rename("rho")


SPELLINGS: dict[str, tuple[str, dict[str, str]]] = {
    "time": ("time", {}),
    "t": ("t", {}),
    "tau": ("tau", {"units": "s"}),
    "epoch": ("epoch", {"axis": "T"}),
    "days": ("n", {"units": "days since 2000-01-01"}),
}


ORDERS = ("zyxt", "xyzt", "ztyx", "zytx", "tzyx")
# Every order with every spelling, and each of both in both stores.
STORED = [
    ((".nc", ".zarr")[(i + j) % 2], order, name) for i, order in enumerate(ORDERS) for j, name in enumerate(SPELLINGS)
]


@pytest.mark.parametrize(("suffix", "dims", "spelling"), STORED)
def test_every_time_is_a_member_wherever_its_axis_is(tmp_path: Path, suffix: str, dims: str, spelling: str) -> None:
    name, attrs = SPELLINGS[spelling]
    for re in (100, 200):
        held = labelled(re, dims, name, attrs)
        path = tmp_path / f"run_{re}{suffix}"
        held.to_netcdf(path, engine="h5netcdf") if suffix == ".nc" else held.to_zarr(path, consolidated=False)
    _check_members(str(tmp_path / f"run_{{Re}}{suffix}"), name)
    stored = StoredEnsemble.open(tmp_path / f"run_100{suffix}", FileMapping(("rho",)))
    assert stored.space.names == (name,)
    for number, time in enumerate(TIMES):
        assert np.array_equal(stored.read(number)["rho"].values, values(100, time))
    with pytest.raises(ValueError, match="has more than three axes: in an ensemble each index of the first is a mem"):
        read_field(tmp_path / f"run_100{suffix}", array="rho")


def _check_members(pattern: str, name: str, array: str = "rho") -> None:
    table, code = members_of(lambda more: match_files(pattern, more_in_files=more), "", Sampling(), (), (array,))
    assert sorted(tuple(row.parameters.items()) for row in table.rows) == [
        (("Re", re), (name, time)) for re in (100.0, 200.0) for time in TIMES
    ]
    for row in table.rows:
        found = read_data(row.path, array=array, reader=code, index=row.index)
        assert np.array_equal(found.values, values(row.parameters["Re"], row.parameters[name]))


def test_axes_that_an_attribute_names_are_moved_too(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["rho"] = np.stack([values(100, t) for t in TIMES], axis=-1)
        file["rho"].attrs.update(axes="z,y,x,time", spacing=(0.125, 0.25, 0.5))
        file["time"] = TIMES
    stored = StoredEnsemble.open(tmp_path / "a.h5", FileMapping(("rho",)))
    assert [row for (row,) in stored.parameters] == list(TIMES)
    assert np.array_equal(stored.read(2)["rho"].values, values(100, 1.0))


@pytest.mark.parametrize("dims", ["yxt", "tyx", "ytx"])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_time_is_never_an_axis_of_space(tmp_path: Path, dims: str, spelling: str) -> None:
    name, attrs = SPELLINGS[spelling]
    labelled(100, f"z{dims}", name, attrs).isel(z=0, drop=True).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    with pytest.raises(ValueError, match=rf"the axes [xy, ]*{name}[xy, ]* do not say which of them is x, y and z"):
        read_field(tmp_path / "a.nc", array="rho")


# ---- a group for each time -------------------------------------------------------------------------------------------


def grouped(path: Path, re: float, name: str, say: Callable[[h5py.Group, float], Any]) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["spacing"] = (0.125, 0.25, 0.5)
        for number, time in enumerate(TIMES):
            group = file.create_group(name.format(number))
            group["rho"] = values(re, time)
            group["p"] = -values(re, time)
            say(group, time)


def as_attribute(group: h5py.Group, time: float) -> None:
    group.attrs["time"] = time


def as_array(group: h5py.Group, time: float) -> None:
    group["time"] = time


def of_array(group: h5py.Group, time: float) -> None:
    group["rho"].attrs["time"] = time


@pytest.mark.parametrize("say", [as_attribute, as_array, of_array])
@pytest.mark.parametrize("name", ["t{}", "Step#{}", "data/{}/fields"])
def test_every_group_is_a_member(tmp_path: Path, name: str, say: Callable[[h5py.Group, float], Any]) -> None:
    for re in (100, 200):
        grouped(tmp_path / f"run_{re}.h5", re, name, say)
    _check_members(str(tmp_path / "run_{Re}.h5"), "time")


def test_groups_are_packed_and_placed_each_in_its_own_way(tmp_path: Path) -> None:
    path = tmp_path / "run_100.h5"
    grouped(path, 100, "t{}", as_attribute)
    with h5py.File(path, "r+") as file:
        del file["t1/rho"]
        file["t1/rho"] = np.rint(values(100, 0.5) * 60000).astype("u2")
        file["t1/rho"].attrs["scale_factor"] = 1 / 60000
        file["t2"].attrs["spacing"] = (1.0, 1.0, 1.0)
    assert np.abs(read_data(path, array="rho", reader="store", index=(1,)).values - values(100, 0.5)).max() < 1e-5
    with pytest.raises(ValueError, match="t2/rho has other axes than t0/rho: save each group as a file"):
        read_data(path, array="rho", reader="store", index=(2,))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [((), "--array, which of p, rho is the field"), (("rho",), r"--parameters: the 3 members, such as 't0', have")],
)
def test_groups_that_say_too_little_are_one_sentence(tmp_path: Path, arrays: tuple[str, ...], message: str) -> None:
    grouped(tmp_path / "run_100.h5", 100, "t{}", lambda group, time: None)
    with pytest.raises(ValueError, match=f"please give {message}"):
        members_of(
            lambda more: match_files(str(tmp_path / "run_{Re}.h5"), more_in_files=more), "", Sampling(), (), arrays
        )
