"""Files of The Well: every step of every trajectory a member, the values those that are stored."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insitu.ensembles.files import FileEnsemble
from insitu.readers.files import read_data, read_field
from insitu.readers.reader import Sampling
from insitu.readers.states import dumps_below, reader_for, table_of_files, with_states
from insitu.readers.tables import MemberTable, match_files
from tests.support.damage import damaged, read_or_refused
from tests.support.well_files import STEPS, TRAJECTORIES, fields, write_well


def members(table: MemberTable, *wanted: str) -> MemberTable:
    reader = reader_for([row.path for row in table.rows])
    assert reader is not None
    assert reader.name == "well"
    return with_states(table, reader, Sampling(), wanted)


@pytest.mark.parametrize(
    ("array", "stored"),
    [
        ("density", lambda held: held["t0_fields/density"][1, 2]),
        ("mask", lambda held: held["t0_fields/mask"]),
        ("velocity_y", lambda held: held["t1_fields/velocity"][1, 2, ..., 1]),
        ("stress_zx", lambda held: held["t2_fields/stress"][1, 2, ..., 2, 0]),
    ],
)
def test_the_values_are_those_that_are_stored(tmp_path: Path, array: str, stored: Any) -> None:
    path = tmp_path / "a.hdf5"
    write_well(path, {"Ma": 0.7})
    found = read_data(path, array=array, index=(1, 2))
    assert np.array_equal(found.values, stored(fields()).transpose(2, 1, 0))  # x y z to z y x
    grid = read_field(path, array="mask", reader="well") if array == "mask" else None
    assert grid is None or (grid.spacing, grid.origin) == ((1.0, 0.5, pytest.approx(0.2)), (0.0, 1.0, -1.0))


def test_its_library_gives_the_same(tmp_path: Path) -> None:
    pytest.importorskip("the_well", reason="the-well is not installed")
    from the_well.utils.export import hdf5_to_xarray

    path = tmp_path / "a.hdf5"
    write_well(path, {"Ma": 0.7})
    with h5py.File(path) as file:
        theirs = hdf5_to_xarray(file)
    ours = read_data(path, array="velocity_z", index=(0, 1))
    assert np.array_equal(ours.values, theirs["velocity"][0, 1, ..., 2].transpose("z", "y", "x"))
    assert np.array_equal(read_data(path, array="density", index=(1, 0)).values.T, theirs["density"][1, 0])


def test_steps_trajectories_and_files_are_members(tmp_path: Path) -> None:
    for mach in (0.7, 2.0):
        write_well(tmp_path / f"MHD_Ma_{mach}.hdf5", {"Ma": mach, "Ms": 0.5}, seed=int(mach))
    found = members(table_of_files(dumps_below(tmp_path)))
    assert found.names == ("Ma", "trajectory", "time")
    assert len(found.rows) == 2 * TRAJECTORIES * STEPS
    assert tuple(found.rows[4].parameters.values()) == (0.7, 1.0, 0.5)
    one = members(match_files(str(tmp_path / "MHD_Ma_{Mach}.hdf5"), more_in_files=True))
    assert one.names == ("Mach", "trajectory", "time")
    ensemble = FileEnsemble.of(found, arrays=("density",), reader="well")
    read = [ensemble.field(member, lambda fraction: None)["density"].values for member in ensemble.members()]
    stored = np.concatenate([fields(seed)["t0_fields/density"].reshape(-1, 4, 5, 6) for seed in (0, 2)])
    assert np.array_equal(np.array(read), stored.transpose(0, 3, 2, 1))
    assert ensemble.record(ensemble.members()[4])["index"] == [1, 1]


def test_times_may_differ_between_trajectories_and_scalars_tell_them_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.hdf5"
    write_well(path, {"Ma": 0.7}, times=[[0, 1, 2], [0, 10, 20]])
    assert [row.parameters["time"] for row in members(table_of_files([path])).rows] == [0, 1, 2, 0, 10, 20]
    with h5py.File(path, "a") as file:
        file["scalars/amplitude"] = [0.1, 0.2]
        file["scalars/amplitude"].attrs.update(sample_varying=True, time_varying=False)
    assert members(table_of_files([path])).names == ("amplitude", "time")


def harmed(path: Path, harm: str) -> None:
    with h5py.File(path, "a") as file:
        if harm == "flat":
            file["dimensions"].attrs["spatial_dims"] = ["x", "y"]
        elif harm == "trajectories":
            file.attrs["n_trajectories"] = 10**15
        elif harm == "words":
            file.attrs["n_trajectories"] = "many"
        elif harm == "time":
            del file["dimensions/time"]
        elif harm == "nan":
            file["dimensions/time"][1] = np.nan
        elif harm == "outside":
            del file["t0_fields/density"]
            file["t0_fields/density"] = h5py.ExternalLink("/etc/other.h5", "density")


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        ("flat", r"its fields have the axes \['x', 'y'\], and so no volume"),
        ("trajectories", "more than the .* GB of memory|no array 'density'"),
        ("words", "n_trajectories must be a whole number"),
        ("time", "it is not a file of The Well"),
        ("nan", "dimensions/time must hold finite numbers"),
        ("outside", "there is no array 'density'"),
    ],
)
def test_a_file_that_lies_is_one_error(tmp_path: Path, harm: str, message: str) -> None:
    path = tmp_path / "a.hdf5"
    write_well(path, {"Ma": 0.7})
    harmed(path, harm)
    with pytest.raises(ValueError, match=message) as caught:
        read_data(path, array="density", reader="well")
    assert str(path) in str(caught.value)


@pytest.mark.slow
@settings(max_examples=60)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "a.hdf5")
        write_well(path, {"Ma": 0.7})
        path.write_bytes(data.draw(damaged(path.read_bytes(), 20000)))
        found = read_or_refused(lambda: read_data(path, array="density", index=(0, 0), reader="well"), path)
        assert found is None or found.values.ndim == 3
