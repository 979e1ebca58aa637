"""Runs with all their times in one file: each time of each run is a member, of netCDF, HDF5 and Zarr."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insitu.commands.reading import ReadingOptions
from insitu.readers.reader import Sampling
from insitu.readers.states import states_of
from insitu.readers.stored import StoredEnsemble
from insitu.readers.tables import TableRow
from tests.support.run_files import SIZES, TIMES, data, field, write

xarray = pytest.importorskip("xarray")


@pytest.mark.parametrize("suffix", ["nc", "h5", "zarr"])
@pytest.mark.parametrize("options", [{}, {"arrays": ("q",)}, {"parameters": "Re,time"}])
def test_every_time_of_every_run_is_a_member(tmp_path: Path, suffix: str, options: dict[str, Any]) -> None:
    if suffix == "zarr":
        pytest.importorskip("zarr")
    for run in (100, 200):
        write(tmp_path / f"run_{run}.{suffix}", run)
    source = ReadingOptions(**options).open([f"{tmp_path}/run_{{Re}}.{suffix}"])
    members = source.members()
    assert source.space.names == ("Re", "time")
    assert [tuple(m.parameters.values()) for m in members] == [(run, t) for run in (100.0, 200.0) for t in TIMES]
    for member in members:
        held = source.field(member, lambda fraction: None)
        held = held["q"] if isinstance(held, dict) else held
        expected = field(int(member.parameters["Re"]))[TIMES.index(member.parameters["time"])]
        assert np.array_equal(held.values, expected)
    assert repr(source).startswith("FileEnsemble: 6 members in 2 files")


def test_the_unit_is_the_first_files_and_another_is_told_once(tmp_path: Path) -> None:
    for year in (2000, 2001, 2002):
        write(tmp_path / f"q_{year}.nc", year, unit=f"days since {year}-01-01")
    with pytest.warns(UserWarning, match="days since 2001-01-01") as caught:
        source = ReadingOptions().open([f"{tmp_path}/q_{{year}}.nc"])
    assert [p.unit for p in source.space.parameters] == ["", "days since 2000-01-01"]
    assert sum("taken as they are" in str(w.message) for w in caught) == 1


def test_a_table_chooses_a_time(tmp_path: Path) -> None:
    for run in (1, 2):
        write(tmp_path / f"run_{run}.nc", run)
    (tmp_path / "runs.csv").write_text("path,Re,time\nrun_1.nc,1,0.5\nrun_2.nc,2,1.0\n")
    source = ReadingOptions().open([str(tmp_path / "runs.csv")])
    assert [row.index for row in source.rows.values()] == [(1,), (2,)]
    row = TableRow(tmp_path / "run_1.nc", {"Re": 1.0})
    assert len(states_of(row, "", Sampling(), ("Re", "time"), ("q",))) == 3


def test_files_of_one_time_each_are_as_before(tmp_path: Path) -> None:
    for run in (1, 2):
        write(tmp_path / f"run_{run}.nc", run, times=[float(run)])
    source = ReadingOptions().open([f"{tmp_path}/run_{{Re}}.nc"])
    assert (source.reader, source.space.names) == ("", ("Re",))


def test_a_field_that_does_not_change_is_read_at_every_time(tmp_path: Path) -> None:
    mask = (tuple(SIZES), np.arange(90.0).reshape(3, 5, 6))
    for run in (1, 2):
        write(tmp_path / f"run_{run}.nc", run, mask=mask)
    source = ReadingOptions(arrays=("q", "mask")).open([f"{tmp_path}/run_{{Re}}.nc"])
    held = source.field(source.members()[4], lambda fraction: None)
    assert np.array_equal(held["mask"].values, mask[1])
    assert np.array_equal(held["q"].values, field(2)[1])


@pytest.mark.parametrize("name", ["run_1.nc", "run_{Re}.nc"])
def test_of_a_time_that_stands_twice_the_later_is_taken_and_told(tmp_path: Path, name: str) -> None:
    for run in (1, 2):
        write(tmp_path / f"run_{run}.nc", run, times=[0.0, 0.5, 0.5, 1.0])
    with pytest.warns(UserWarning, match=r"states stand twice in a file, the later one is taken: .*time 0\.5"):
        source = ReadingOptions().open([str(tmp_path / name)])
    members = [member for member in source.members() if member.parameters.get("Re", 1.0) == 1.0]
    assert [member.parameters["time"] for member in members] == TIMES
    for member, index in zip(members, (0, 2, 3), strict=True):
        held = source.field(member, lambda fraction: None)
        assert np.array_equal((held["q"] if isinstance(held, dict) else held).values, field(1, 4)[index])


def test_other_members_must_differ(tmp_path: Path) -> None:
    data(1, times=[1.0, 2.0, 1.0]).rename(time="Re").to_netcdf(tmp_path / "a.nc")
    with pytest.raises(ValueError, match="several members have the parameters Re 1"):
        ReadingOptions(parameters="Re").open([str(tmp_path / "a.nc")])


@pytest.mark.parametrize("calendar", ["noleap", "360_day", "gregorian"])
def test_times_of_every_calendar_are_its_numbers(tmp_path: Path, calendar: str) -> None:
    cftime = pytest.importorskip("cftime")
    unit = "days since 2000-01-01"
    moments = [cftime.datetime(2000, month, 1, calendar=calendar) for month in (1, 3, 5)]
    made = data(1, times=cftime.date2num(moments, unit, calendar))
    made["time"].attrs.update(units=unit, calendar=calendar)
    made.to_netcdf(tmp_path / "a.nc")
    opened = StoredEnsemble.open(tmp_path / "a.nc")
    assert opened.parameters == tuple((float(n),) for n in cftime.date2num(moments, unit, calendar))
    assert opened.space.parameters[0].unit == unit
