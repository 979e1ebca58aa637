"""Every time of a file that holds several is a member, with the time as its parameter."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pytest
import pyvista
import vtk

from insitu.commands.reading import ReadingOptions
from insitu.readers.files import read_data, read_field
from render.datasets import to_grid

COUNTS = (6, 5, 4)
TIMES = (0.0, 0.5, 2.0)


def values(number: int) -> np.ndarray:
    return (np.arange(120.0) + 1000 * number).reshape(COUNTS[::-1]).astype("f4")  # [z, y, x]


def image(number: int) -> pyvista.ImageData:
    made = pyvista.ImageData(dimensions=COUNTS)
    made["t"] = values(number).ravel()
    return made


def collection(folder: Path) -> Path:
    rows = ""
    for number in (2, 0, 1):  # in no order
        image(number).save(folder / f"{number}.vti")
        rows += f'<DataSet timestep="{TIMES[number]}" part="0" file="{number}.vti"/>'
    (folder / "a.pvd").write_text(f'<VTKFile type="Collection" version="0.1"><Collection>{rows}</Collection></VTKFile>')
    return folder / "a.pvd"


def series(folder: Path) -> Path:
    for number in range(3):
        image(number).save(folder / f"{number}.vti")
    rows = [{"name": f"{number}.vti", "time": time} for number, time in enumerate(TIMES)]
    (folder / "a.vti.series").write_text(json.dumps({"file-series-version": "1.0", "files": rows}))
    return folder / "a.vti.series"


def xdmf(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        for number in range(3):
            file[f"t{number}"] = values(number)
    grids = "".join(
        f'<Grid Name="g" GridType="Uniform"><Time Value="{time}"/><Topology TopologyType="3DCoRectMesh" Dimensions="4 5 6"/>'
        '<Geometry GeometryType="ORIGIN_DXDYDZ"><DataItem Dimensions="3" Format="XML">0 0 0</DataItem>'
        '<DataItem Dimensions="3" Format="XML">1 1 1</DataItem></Geometry><Attribute Name="t" Center="Node">'
        f'<DataItem Dimensions="4 5 6" NumberType="Float" Precision="4" Format="HDF">a.h5:/t{number}</DataItem>'
        "</Attribute></Grid>"
        for number, time in enumerate(TIMES)
    )
    (folder / "a.xmf").write_text(
        '<?xml version="1.0" ?><!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []><Xdmf Version="2.0"><Domain>'
        f'<Grid GridType="Collection" CollectionType="Temporal">{grids}</Grid></Domain></Xdmf>'
    )
    return folder / "a.xmf"


def in_time(mesh: Callable[[int], pyvista.DataSet]) -> vtk.vtkAlgorithm:
    """A source of data sets at TIMES."""
    from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase

    class Source(VTKPythonAlgorithmBase):
        def __init__(self) -> None:
            super().__init__(nInputPorts=0, nOutputPorts=1, outputType=mesh(0).GetClassName())

        def RequestInformation(self, request, inputs, outputs) -> int:
            information = outputs.GetInformationObject(0)
            information.Set(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS(), TIMES, len(TIMES))
            information.Set(vtk.vtkStreamingDemandDrivenPipeline.TIME_RANGE(), (TIMES[0], TIMES[-1]), 2)
            return 1

        def RequestData(self, request, inputs, outputs) -> int:
            information = outputs.GetInformationObject(0)
            time = information.Get(vtk.vtkStreamingDemandDrivenPipeline.UPDATE_TIME_STEP()) or 0.0
            made = vtk.vtkDataObject.GetData(information)
            made.ShallowCopy(mesh(TIMES.index(time)))
            made.GetInformation().Set(vtk.vtkDataObject.DATA_TIME_STEP(), time)
            return 1

    return Source()


def exodus(folder: Path) -> Path:
    """Hexahedra of eight nodes, by the format's definition."""
    mesh = image(0).cast_to_structured_grid().cast_to_unstructured_grid()
    with netCDF4.Dataset(folder / "a.exo", "w", format="NETCDF3_CLASSIC") as file:
        file.setncatts(
            {
                "api_version": np.float32(5),
                "version": np.float32(5),
                "floating_point_word_size": 8,
                "file_size": 1,
                "title": "t",
            }
        )
        sizes = {"num_dim": 3, "num_nodes": 120, "num_elem": 60, "num_el_blk": 1, "num_el_in_blk1": 60}
        for name, size in {
            "len_string": 33,
            "time_step": None,
            "num_nod_per_el1": 8,
            "num_nod_var": 1,
            **sizes,
        }.items():
            file.createDimension(name, size)
        file.createVariable("time_whole", "f8", ("time_step",))[:] = TIMES
        for letter, along in zip("xyz", mesh.points.T, strict=True):
            file.createVariable(f"coord{letter}", "f8", ("num_nodes",))[:] = along
        connect = file.createVariable("connect1", "i4", ("num_el_in_blk1", "num_nod_per_el1"))
        connect.elem_type = "HEX8"
        connect[:] = mesh.cell_connectivity.reshape(-1, 8) + 1
        file.createVariable("eb_status", "i4", ("num_el_blk",))[:] = 1
        number = file.createVariable("eb_prop1", "i4", ("num_el_blk",))
        number.setncattr("name", "ID")
        number[:] = 1
        name = file.createVariable("name_nod_var", "S1", ("num_nod_var", "len_string"))
        name[0, :2] = [b"t", b"\0"]
        held = file.createVariable("vals_nod_var1", "f8", ("time_step", "num_nodes"))
        for step in range(3):
            held[step] = values(step).ravel()
    return folder / "a.exo"


def ensight(folder: Path) -> Path:
    """Three files of values on a uniform block, beside one of geometry: by the format's definition, in text."""
    geometry = "a\nb\nnode id off\nelement id off\npart\n" + f"{1:10d}\n"
    geometry += "grid\nblock uniform\n" + "".join(f"{n:10d}" for n in COUNTS) + "\n"
    geometry += "".join(f"{x:12.5e}\n" for x in (0, 0, 0, 1, 1, 1))
    (folder / "a.geo").write_text(geometry)
    for number in range(3):
        rows = "".join(f"{value:12.5e}\n" for value in values(number).ravel())
        (folder / f"a.t{number}").write_text(f"t\npart\n{1:10d}\nblock\n{rows}")
    (folder / "a.case").write_text(
        "FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: a.geo\nVARIABLE\nscalar per node: 1 t a.t*\n"
        "TIME\ntime set: 1\nnumber of steps: 3\nfilename start number: 0\nfilename increment: 1\n"
        f"time values: {' '.join(map(str, TIMES))}\n"
    )
    return folder / "a.case"


def hdf(folder: Path) -> Path:
    writer = vtk.vtkHDFWriter()
    source = in_time(lambda number: image(number).cast_to_unstructured_grid())
    writer.SetInputConnection(source.GetOutputPort())
    writer.SetFileName(str(folder / "a.vtkhdf"))
    writer.SetWriteAllTimeSteps(True)
    writer.Write()
    return folder / "a.vtkhdf"


MAKE = {f.__name__: f for f in (collection, series, xdmf, exodus, ensight, hdf)}


@pytest.mark.filterwarnings("ignore::render.datasets.ResamplingWarning")
@pytest.mark.parametrize("kind", MAKE)
def test_each_time_is_a_member(tmp_path: Path, kind: str) -> None:
    path = MAKE[kind](tmp_path)
    stored = ReadingOptions(arrays=("t",)).open([str(path)])
    assert stored.space.names == ("time",)
    members = stored.members()
    assert [member.parameters["time"] for member in members] == list(TIMES)
    for number, member in enumerate(members):
        grid = to_grid(stored.field(member, lambda fraction: None)["t"], warn=False)
        np.testing.assert_allclose(grid.values, values(number), atol=1e-2)
        assert stored.record(member)["index"] == [number]


@pytest.mark.parametrize("kind", MAKE)
def test_one_field_of_a_file_is_that_of_its_first_time_and_says_so(tmp_path: Path, kind: str) -> None:
    path = MAKE[kind](tmp_path)
    with pytest.warns(UserWarning, match=r"holds 3 times, of which the first, 0, is taken"):
        grid = read_field(path, array="t")
    np.testing.assert_allclose(grid.values, values(0), atol=1e-2)


@pytest.mark.parametrize("kind", ["exodus", "hdf", "xdmf", "collection", "series", "ensight"])
def test_one_that_is_cut_is_refused_wherever_it_ends(tmp_path: Path, kind: str) -> None:
    path = MAKE[kind](tmp_path)
    cut = {
        "xdmf": tmp_path / "a.h5",
        "collection": tmp_path / "0.vti",
        "series": tmp_path / "0.vti",
        "ensight": tmp_path / "a.t0",
    }.get(kind, path)
    whole = cut.read_bytes()
    for share in (0.1, 0.5, 0.8, 0.95, 0.99):
        cut.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(ValueError, match=re.escape(str(path))):
            read_data(path, array="t", index=(0,))


@pytest.mark.parametrize("count", [2, 3])
def test_times_join_what_a_pattern_says(tmp_path: Path, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(count):
        (tmp_path / f"run_{number}").mkdir()
        collection(tmp_path / f"run_{number}")
    monkeypatch.chdir(tmp_path)
    stored = ReadingOptions(arrays=("t",)).open(["run_{Re}/a.pvd"])
    assert stored.space.names == ("Re", "time")
    assert len(stored) == 3 * count


def test_one_time_is_no_parameter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(3):
        image(number).save(tmp_path / f"{number}.vti")
        row = f'<DataSet timestep="7" file="{number}.vti"/>'
        text = f'<VTKFile type="Collection" version="0.1"><Collection>{row}</Collection></VTKFile>'
        (tmp_path / f"run_{number}.pvd").write_text(text)
    monkeypatch.chdir(tmp_path)
    stored = ReadingOptions().open(["run_{Re}.pvd"])
    assert stored.space.names == ("Re",)
    assert stored.record(stored.members()[0]).keys() >= {"contents", "file"}


@pytest.mark.parametrize("text", ['{"files": 3}', '{"files": [{"name": "0.vti", "time": "x"}]}', "[]", "{"])
def test_a_damaged_list_is_named(tmp_path: Path, text: str) -> None:
    image(0).save(tmp_path / "0.vti")
    (tmp_path / "a.series").write_text(text)
    with pytest.raises(ValueError, match=r"a\.series"):
        read_field(tmp_path / "a.series")
