"""Files of VTK that are cut short, or lack a part, are one error that names them, wherever the cut is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
import vtk

from insitu.readers.files import read_data, read_field
from insitu.readers.legacy_vtk import check_legacy
from tests.support.vtk_writers import GRIDS, VALUES, image


def legacy(path: Path, kind: str, binary: bool, version: int = 51) -> None:
    writer = vtk.vtkDataSetWriter()
    writer.SetInputData(GRIDS[kind][0]())
    writer.SetFileName(str(path))
    writer.SetFileVersion(version)
    writer.SetFileType(2 if binary else 1)
    writer.Write()


def xml(path: Path, kind: str, mode: str, parallel: bool = False) -> None:
    writer = GRIDS[kind][1]()
    writer.SetInputData(GRIDS[kind][0]())
    writer.SetFileName(str(path))
    {"ascii": writer.SetDataModeToAscii, "inline": writer.SetDataModeToBinary}.get(mode, writer.SetDataModeToAppended)()
    writer.SetEncodeAppendedData(mode == "base64")
    if mode != "compressed":
        writer.SetCompressorTypeToNone()
    writer.Write()


def nrrd(path: Path, head: str = "", name: str = "") -> None:
    text = (
        f"NRRD0004\ntype: float\ndimension: 3\nsizes: 11 8 7\nspacings: 1 1 1\nendian: little\nencoding: raw\n{head}\n"
    )
    path.write_bytes(text.encode() + (b"" if name else VALUES.tobytes()))
    if name:
        path.with_name(name).write_bytes(VALUES.tobytes())


def meta(path: Path, name: str = "LOCAL") -> None:
    text = f"ObjectType = Image\nNDims = 3\nDimSize = 11 8 7\nElementType = MET_FLOAT\nElementDataFile = {name}\n"
    path.write_bytes(text.encode() + (VALUES.tobytes() if name == "LOCAL" else b""))
    if name != "LOCAL":
        path.with_name(name).write_bytes(VALUES.tobytes())


FILES: dict[str, Callable[[Path], None]] = {
    **{
        f"{kind}{'b' if binary else 'a'}{version}.vtk": lambda path, k=kind, b=binary, v=version: legacy(path, k, b, v)
        for kind in GRIDS
        for binary in (False, True)
        for version in (42, 51)
    },
    **{
        f"{mode}.vt{kind}": lambda path, k=kind, m=mode: xml(path, k, m)
        for kind in GRIDS
        for mode in ("ascii", "inline", "base64", "raw", "compressed")
    },
    "a.nrrd": nrrd,
    "a.mha": meta,
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_cut_is_named_wherever_it_ends(tmp_path: Path, name: str) -> None:
    FILES[name](tmp_path / name)
    whole = (tmp_path / name).read_bytes()
    np.testing.assert_allclose(read_field(tmp_path / name).values, VALUES, atol=2e-5)
    shared = 12 if name.endswith((".vtk", ".mha", ".nrrd")) else 24  # a line's end, or the closing tag and what follows
    for end in [*np.linspace(1, len(whole) - shared, 23).astype(int)]:
        cut = tmp_path / f"cut{Path(name).suffix}"
        cut.write_bytes(whole[:end])
        with pytest.raises(ValueError, match=f"cut{Path(name).suffix}") as caught:
            read_field(cut, array="t")
        assert len(str(caught.value)) < 500
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("lines", [1, 2, 3])
def test_every_byte_of_a_legacy_file_counts(tmp_path: Path, lines: int) -> None:
    legacy(tmp_path / "a.vtk", "i", binary=True)
    whole = (tmp_path / "a.vtk").read_bytes()
    begins = whole.index(b"SCALARS") + 40
    for end in range(begins, len(whole) - 1, 7 + lines):
        (tmp_path / "b.vtk").write_bytes(whole[:end])
        with pytest.raises(ValueError, match="was it cut short"):
            check_legacy(tmp_path / "b.vtk")


@pytest.mark.parametrize("name", ["a.nhdr", "a.mhd", "a.nrrd", "a.mha"])
@pytest.mark.parametrize("change", [-4, 4])
def test_a_raw_file_has_as_many_bytes_as_its_header_says(tmp_path: Path, name: str, change: int) -> None:
    data = tmp_path / ("a.raw" if name in ("a.nhdr", "a.mhd") else name)
    if "n" in name:
        nrrd(tmp_path / name, *(("data file: a.raw\n", "a.raw") if data.name == "a.raw" else ()))
    else:
        meta(tmp_path / name, *(("a.raw",) if data.name == "a.raw" else ()))
    np.testing.assert_array_equal(read_field(tmp_path / name).values, VALUES)
    held = data.read_bytes()
    data.write_bytes(held[:change] if change < 0 else held + bytes(change))
    with pytest.raises(
        ValueError, match=f"has {VALUES.nbytes + change} bytes of values, its header claims {VALUES.nbytes}"
    ):
        read_field(tmp_path / name)


def halves() -> list[Any]:
    return [image().extract_subset((0, 4, 0, 7, 0, 6)), image().extract_subset((4, 10, 0, 7, 0, 6))]


def blocks(folder: Path) -> tuple[Path, Path]:
    pyvista.MultiBlock(halves()).save(folder / "a.vtm")
    return folder / "a.vtm", folder / "a" / "a_1.vti"


def nested(folder: Path) -> tuple[Path, Path]:
    pyvista.MultiBlock([pyvista.MultiBlock(halves())]).save(folder / "a.vtm")
    return folder / "a.vtm", next((folder / "a").rglob("*_1.vti"))


def collection(folder: Path) -> tuple[Path, Path]:
    for number, half in enumerate(halves()):
        half.save(folder / f"{number}.vti")
    rows = "".join(f'<DataSet timestep="0" part="{i}" file="{i}.vti"/>' for i in range(2))
    (folder / "a.pvd").write_text(f'<VTKFile type="Collection" version="0.1"><Collection>{rows}</Collection></VTKFile>')
    return folder / "a.pvd", folder / "1.vti"


def pieces(folder: Path) -> tuple[Path, Path]:
    for number, half in enumerate(halves()):
        half.cast_to_unstructured_grid().save(folder / f"a_{number}.vtu")
    kind = half.cast_to_unstructured_grid().points.dtype.name.title()
    (folder / "a.pvtu").write_text(
        '<VTKFile type="PUnstructuredGrid" version="0.1" byte_order="LittleEndian"><PUnstructuredGrid GhostLevel="0">'
        '<PPointData><PDataArray type="Float32" Name="t"/></PPointData>'
        f'<PPoints><PDataArray type="{kind}" NumberOfComponents="3"/></PPoints>'
        '<Piece Source="a_0.vtu"/><Piece Source="a_1.vtu"/></PUnstructuredGrid></VTKFile>'
    )
    return folder / "a.pvtu", folder / "a_1.vtu"


def partitions(folder: Path) -> tuple[Path, Path]:
    held = vtk.vtkPartitionedDataSetCollection()
    for number, half in enumerate(halves()):
        held.SetPartition(number, 0, half)
    writer = vtk.vtkXMLPartitionedDataSetCollectionWriter()
    writer.SetInputData(held)
    writer.SetFileName(str(folder / "a.vtpc"))
    writer.Write()
    return folder / "a.vtpc", sorted((folder / "a").rglob("*.vti"))[1]


@pytest.mark.parametrize("make", [blocks, nested, collection, pieces, partitions])
@pytest.mark.parametrize("harm", ["absent", "cut", "empty", "garbage"])
def test_a_part_that_is_absent_or_damaged_is_named(tmp_path: Path, make: Any, harm: str) -> None:
    path, part = make(tmp_path)
    assert read_field(path).shape == VALUES.shape
    if harm == "absent":
        part.unlink()
    else:
        part.write_bytes({"cut": part.read_bytes()[:-40], "empty": b"", "garbage": b"garbage </VTKFile>"}[harm])
    with pytest.raises(ValueError, match=part.name) as caught:
        read_data(path)
    assert str(caught.value).startswith(str(path))


def test_messages_of_vtk_go_where_they_went_before(tmp_path: Path) -> None:
    window, shown = vtk.vtkOutputWindow.GetInstance(), vtk.vtkObject.GetGlobalWarningDisplay()
    path, part = blocks(tmp_path)
    part.write_bytes(b"<VTKFile></VTKFile>")
    with pytest.raises(ValueError, match="VTK says"):
        read_data(path)
    assert vtk.vtkOutputWindow.GetInstance() is window
    assert vtk.vtkObject.GetGlobalWarningDisplay() == shown


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ({"a": ("b.vti", "a.vtm")}, r"a\.vtm: it names a\.vtm, of which it is a part itself"),
        ({"a": ("./a.vtm",)}, r"a\.vtm: it names a\.vtm, of which"),
        ({"a": ("b.vtm", "b.vti"), "b": ("c.vtm",), "c": ("a.vtm",)}, r"b\.vtm: c\.vtm: it names a\.vtm, of which"),
        ({f"{chr(97 + i)}": (f"{chr(98 + i)}.vtm",) for i in range(12)}, "i.vtm, which is more than 8 files deep"),
    ],
    ids=["itself", "itself by another path", "a circle of three", "too deep"],
)
def test_files_that_contain_themselves_are_refused(
    tmp_path: Path, named: dict[str, tuple[str, ...]], message: str
) -> None:
    xml(tmp_path / "b.vti", "i", "ascii")
    for name, files in named.items():
        inner = "".join(f'<DataSet index="{number}" file="{file}"/>' for number, file in enumerate(files))
        text = f"<vtkMultiBlockDataSet>{inner}</vtkMultiBlockDataSet>"
        (tmp_path / f"{name}.vtm").write_text(f'<VTKFile type="vtkMultiBlockDataSet" version="1.0">{text}</VTKFile>')
    (tmp_path / "m.vtm").touch()
    with pytest.raises(ValueError, match=message):
        read_data(tmp_path / "a.vtm")
