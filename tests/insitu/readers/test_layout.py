"""Ensembles as their makers wrote them: every layout gives the same members, and what is missing is asked for at once."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from insitu.readers.layout import FileMapping
from insitu.readers.stored import StoredEnsemble
from render import to_grid

COUNT, SHAPE = 6, (4, 5, 6)
RANDOM = np.random.default_rng(0)
FIELD = RANDOM.random((COUNT, *SHAPE)).astype(np.float32)  # [M, nz, ny, nx]
PARAMETERS = RANDOM.random((COUNT, 2))  # [M, P]
SPACING, ORIGIN = (1.0, 2.0, 3.0), (0.5, 0.0, 10.0)


def attributes(file: h5py.File, **more: Any) -> None:
    file.attrs.update(spacing=SPACING, origin=ORIGIN, **more)


def own(file: h5py.File) -> None:
    file["field"], file["params"] = FIELD, PARAMETERS
    attributes(file, names=["a", "b"], lower=[0.0, 0.0], upper=[1.0, 1.0])


def other_names(file: h5py.File) -> None:
    """`parameter_names` for `names`, one text of units, and no split."""
    file["density"], file["inputs"] = FIELD, PARAMETERS
    attributes(file, parameter_names=["a", "b"], units="m/s, K")


def names_on_the_table(file: h5py.File) -> None:
    table = file.create_dataset("sim/design_points", data=PARAMETERS)
    table.attrs["columns"] = '["a", "b"]'
    file["sim/T"] = FIELD
    file["sim"].attrs.update(dx=1.0, dy=2.0, dz=3.0, origin=ORIGIN)


def names_in_an_array(file: h5py.File) -> None:
    file["volumes"], file["theta"] = FIELD, PARAMETERS
    file["labels"] = np.array(["a", "b"], dtype="S")
    attributes(file)


def one_array_for_each(file: h5py.File) -> None:
    file["u"], file["a"], file["b"] = FIELD, PARAMETERS[:, 0], PARAMETERS[:, 1]
    file["index"] = np.arange(COUNT)
    file["u"].attrs["voxel_size"] = SPACING
    file.attrs["origin"] = ORIGIN


def a_table_with_columns(file: h5py.File) -> None:
    file["u"] = FIELD
    file["runs"] = np.array([tuple(row) for row in PARAMETERS], dtype=[("a", "f8"), ("b", "f8")])
    attributes(file)


def axes_by_name(file: h5py.File) -> None:
    """Values [member, x, y, z], which an attribute says."""
    file["field"], file["params"] = FIELD.transpose(0, 3, 2, 1), PARAMETERS
    attributes(file, names=["a", "b"], axes="member,x,y,z (cell values)")


def scales(file: h5py.File) -> None:
    """Dimension scales with coordinates, as netCDF writes them."""
    file["q"] = FIELD
    for number, (name, start, step) in enumerate(zip("zyx", ORIGIN[::-1], SPACING[::-1], strict=True), start=1):
        file[name] = start + step * np.arange(SHAPE[number - 1])
        file[name].make_scale(name)
        file["q"].dims[number].attach_scale(file[name])
    file["a"], file["b"] = PARAMETERS.T


def arrays_with_attributes(file: h5py.File) -> None:
    for number in range(COUNT):
        array = file.create_dataset(f"run_{number}", data=FIELD[number])
        array.attrs.update(a=PARAMETERS[number, 0], b=PARAMETERS[number, 1], gamma=1.4, step=number)
    attributes(file)


def groups_with_attributes(file: h5py.File) -> None:
    for number in range(COUNT):
        group = file.create_group(f"members/{number + 8}")  # 8, 9, 10, ...: by number, not by letters
        group["density"] = FIELD[number]
        group.attrs.update(a=PARAMETERS[number, 0], b=PARAMETERS[number, 1])
    attributes(file)


def groups_with_values(file: h5py.File) -> None:
    for number in range(COUNT):
        group = file.create_group(f"m{number:03d}")
        group["density"], group["a"], group["b"] = FIELD[number], PARAMETERS[number, 0], [PARAMETERS[number, 1]]
    attributes(file)


HDF5 = [
    own,
    other_names,
    names_on_the_table,
    names_in_an_array,
    one_array_for_each,
    a_table_with_columns,
    axes_by_name,
    scales,
    arrays_with_attributes,
    groups_with_attributes,
    groups_with_values,
]


def is_the_ensemble(opened: StoredEnsemble) -> None:
    assert opened.space.names == ("a", "b")
    assert np.array_equal(opened.parameters, PARAMETERS)
    assert opened.splits == ("train",) * COUNT
    assert opened.shape == SHAPE
    for number in (0, COUNT - 1):
        (field,) = opened.read(number).values()
        grid = to_grid(field)
        assert np.array_equal(grid.values, FIELD[number])
        assert grid.spacing == pytest.approx(SPACING)
        assert grid.origin == pytest.approx(ORIGIN)


@pytest.mark.parametrize("write", HDF5, ids=lambda write: write.__name__)
def test_a_layout_is_found(tmp_path: Path, write: Callable[[h5py.File], None]) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        write(file)
    is_the_ensemble(StoredEnsemble.open(tmp_path / "a.h5"))


def labelled(**coordinates: Any) -> Any:
    xarray = pytest.importorskip("xarray")
    places = {n: (n, o + s * np.arange(c)) for n, o, s, c in zip("xyz", ORIGIN, SPACING, SHAPE[::-1], strict=True)}
    return xarray.Dataset({"u": (("run", "z", "y", "x"), FIELD, {"units": "K"})}, coords={**places, **coordinates})


@pytest.mark.parametrize("name", ["a.nc", "classic.nc", "a.h5", "a.zarr", "bare.zarr"])
def test_netcdf_and_zarr_are_read_alike(tmp_path: Path, name: str) -> None:
    data = labelled(a=("run", PARAMETERS[:, 0]), b=("run", PARAMETERS[:, 1])).transpose("run", "x", "z", "y")
    path = tmp_path / name
    if name == "bare.zarr":
        zarr = pytest.importorskip("zarr")
        group = zarr.open_group(path, mode="w")
        group.create_array("field", data=FIELD)
        group.create_array("params", data=PARAMETERS)
        group.attrs.update(names=["a", "b"], spacing=SPACING, origin=ORIGIN)
    elif name == "a.zarr":
        data.to_zarr(path, consolidated=False)
    else:
        data.to_netcdf(tmp_path / "a.nc", engine="scipy" if name == "classic.nc" else "h5netcdf")
        shutil.move(tmp_path / "a.nc", path)
    is_the_ensemble(StoredEnsemble.open(path))


def test_packed_values_are_unpacked(tmp_path: Path) -> None:
    packing = {"u": {"dtype": "int16", "scale_factor": 1e-4, "add_offset": 0.5, "_FillValue": -9999}}
    data = labelled(a=("run", PARAMETERS[:, 0]))
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", encoding=packing)
    (field,) = StoredEnsemble.open(tmp_path / "a.nc").read(2).values()
    assert np.allclose(field.values, FIELD[2], atol=1e-4)


def test_coordinates_of_the_first_axes_are_parameters(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    values = FIELD.reshape(2, 3, *SHAPE)
    data = xarray.Dataset(
        {"u": (("Re", "time", "z", "y", "x"), values)}, coords={"Re": [100.0, 200.0], "time": [0.0, 1.0, 2.0]}
    )
    data.attrs["spacing"] = SPACING
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    opened = StoredEnsemble.open(tmp_path / "a.nc")
    assert opened.space.names == ("Re", "time")
    assert opened.parameters[4] == (200.0, 1.0)
    assert np.array_equal(opened.read(4)["u"].values, values[1, 1])


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
@pytest.mark.parametrize("numbered", [True, False])
def test_members_and_times_of_xarray_are_told_apart_by_what_is_said_of_each(
    tmp_path: Path, suffix: str, numbered: bool
) -> None:
    xarray = pytest.importorskip("xarray")
    values = FIELD.reshape(2, 3, *SHAPE)
    said = {"Re": ("member", [100.0, 200.0]), "nu": ("member", [0.2, 0.1])}
    number = {"member": [0, 1]} if numbered else {}
    data = xarray.Dataset(
        {"u": (("member", "time", "z", "y", "x"), values)}, coords={**said, "time": [0.0, 1.0, 2.0], **number}
    )
    data.attrs["spacing"] = SPACING
    path = tmp_path / f"a{suffix}"
    if suffix == ".zarr":
        data.to_zarr(path, consolidated=False)
    else:
        data.to_netcdf(path, engine="h5netcdf")
    opened = StoredEnsemble.open(path)
    assert sorted(opened.space.names) == ["Re", "nu", "time"]
    named = dict(zip(opened.space.names, opened.parameters[4], strict=True))
    assert named == {"Re": 200.0, "nu": 0.1, "time": 1.0}
    assert np.array_equal(opened.read(4)["u"].values, values[1, 1])
    chosen = StoredEnsemble.open(path, FileMapping(parameters=("Re", "time")))
    assert chosen.parameters[4] == (200.0, 1.0)


def without(write: Callable[[h5py.File], None], *names: str, **more: Any) -> Callable[[h5py.File], None]:
    def changed(file: h5py.File) -> None:
        write(file)
        for name in names:
            del (file.attrs if name in file.attrs else file)[name]
        for name, value in more.items():
            file[name] = value

    return changed


@pytest.mark.parametrize(
    ("write", "mapped", "arguments"),
    [
        (without(own, "names"), FileMapping(names=("a", "b")), {}),
        (without(own, "spacing", "origin"), FileMapping(), {"spacing": SPACING, "origin": ORIGIN}),
        (without(own, more=FIELD), FileMapping(fields=("field",), parameters=("params",)), {}),
        (without(other_names, temperature=FIELD + 1), FileMapping(fields=("density",)), {}),
        (without(one_array_for_each, c=PARAMETERS[:, 0]), FileMapping(parameters=("a", "b")), {}),
        (without(arrays_with_attributes), FileMapping(parameters=("a", "b")), {}),
        (without(axes_by_name, "axes"), FileMapping(dims=("x", "y", "z")), {}),
        (without(own, phase=["train"] * COUNT), FileMapping(split="phase"), {}),
        (without(own, which=PARAMETERS + 1), FileMapping(), {}),
    ],
)
def test_what_is_not_found_is_said(
    tmp_path: Path, write: Callable[[h5py.File], None], mapped: FileMapping, arguments: dict[str, Any]
) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        write(file)
    is_the_ensemble(StoredEnsemble.open(tmp_path / "a.h5", mapped, **arguments))


@pytest.mark.parametrize(
    ("write", "mapped", "message"),
    [
        (
            without(own, "names"),
            FileMapping(),
            r"please give --names, the names of the 2 columns of 'params'; the file holds field",
        ),
        (without(own, "spacing"), FileMapping(), "please give --spacing"),
        (without(own, "params"), FileMapping(), r"please give --parameters, an array \(6, parameter\)"),
        (without(other_names, temperature=FIELD), FileMapping(), r"--array, which of density, temperature"),
        (
            without(names_in_an_array, "theta", p=PARAMETERS, q=PARAMETERS),
            FileMapping(),
            r"--parameters, which of p, q",
        ),
        (own, FileMapping(parameters=("nothing",)), r"--parameters nothing are not arrays of 6 members"),
        (own, FileMapping(names=("a",)), "names of 2 parameters"),
        (own, FileMapping(split="nothing"), "--split: there is no array 'nothing'"),
        (own, FileMapping(dims=("x", "x", "z")), "an order of"),
        (lambda file: file.attrs.update(a=1), FileMapping(), "there is no field"),
        (lambda file: file.update(field=FIELD[0]), FileMapping(), r"\(member, z, y, x\), got shape"),
        (without(arrays_with_attributes), FileMapping(parameters=("c",)), r"c are not numbers of every member"),
        (
            without(own, "params", "lower", "upper", params=np.ones((6, 2))),
            FileMapping(),
            "'a' is 1 in every member: give --bounds a",
        ),
    ],
)
def test_what_is_missing_is_asked_for_with_what_is_there(
    tmp_path: Path, write: Callable[[h5py.File], None], mapped: FileMapping, message: str
) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        write(file)
    with pytest.raises(ValueError, match=message) as caught:
        StoredEnsemble.open(tmp_path / "a.h5", mapped)
    assert "a.h5" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bounds_may_be_given(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        other_names(file)
    opened = StoredEnsemble.open(tmp_path / "a.h5", bounds={"b": (-1.0, 2.0)})
    assert [(p.low, p.high, p.unit) for p in opened.space.parameters] == [
        (PARAMETERS[:, 0].min(), PARAMETERS[:, 0].max(), "m/s"),
        (-1.0, 2.0, "K"),
    ]
    with pytest.raises(ValueError, match=r"--bounds of c"):
        StoredEnsemble.open(tmp_path / "a.h5", bounds={"c": (0.0, 1.0)})
