"""Arrays of VTK's XML files are those that were written, or refused, whatever lies about their sizes."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import vtk

from insitu.readers.files import read_field
from insitu.readers.vtk_xml_arrays import check_arrays
from tests.support.vtk_writers import GRIDS, VALUES

COMPRESSORS = ("None", "ZLib", "LZ4", "LZMA")
MODES = ("raw", "base64", "inline", "ascii")
SIZES = ("UInt32", "UInt64")


def write(
    path: Path,
    kind: str,
    compressor: str,
    mode: str,
    size: str,
    order: int = 1,
    pieces: int = 1,
    *,
    value: float | None = None,
) -> bytes:
    """Writes a small grid in blocks of 512 bytes, its field `value` everywhere if that is given; returns the file."""
    writer: Any = GRIDS[kind][1]()
    made = GRIDS[kind][0]()
    if value is not None:
        made["t"] = np.full(made.n_points, value, dtype="f4")
    made["v"] = np.arange(3.0 * made.n_points).reshape(-1, 3)
    made.cell_data["c"] = np.arange(made.n_cells, dtype="i2")
    made.field_data["time"] = [1.5]
    made.field_data["word"] = ["a", "bc"]
    writer.SetInputData(made)
    writer.SetFileName(str(path))
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    getattr(writer, f"SetHeaderTypeTo{size}")()
    {"ascii": writer.SetDataModeToAscii, "inline": writer.SetDataModeToBinary}.get(mode, writer.SetDataModeToAppended)()
    writer.SetEncodeAppendedData(mode == "base64")
    writer.SetByteOrder(order)
    writer.SetBlockSize(512)
    if hasattr(writer, "SetNumberOfPieces"):
        writer.SetNumberOfPieces(pieces)
    writer.Write()
    return path.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("kind", GRIDS)
def test_whole_files_pass(tmp_path: Path, kind: str) -> None:
    in_pieces = itertools.product(COMPRESSORS, MODES, ("UInt64",), (1,), (3,))
    for how in (*itertools.product(COMPRESSORS, MODES, SIZES, (0, 1)), *in_pieces):
        write(tmp_path / f"a.vt{kind}", kind, *how)
        check_arrays(tmp_path / f"a.vt{kind}")


def test_other_data_sets_pass(tmp_path: Path) -> None:
    trees = vtk.vtkRandomHyperTreeGridSource()
    for source, writer, name in (
        (trees, vtk.vtkXMLHyperTreeGridWriter(), "a.htg"),
        (vtk.vtkSphereSource(), vtk.vtkXMLPolyDataWriter(), "a.vtp"),
        (vtk.vtkAppendFilter(), vtk.vtkXMLUnstructuredGridWriter(), "empty.vtu"),
    ):
        if isinstance(source, vtk.vtkAppendFilter):
            writer.SetInputData(vtk.vtkUnstructuredGrid())
        else:
            source.Update()
            writer.SetInputData(source.GetOutputDataObject(0))
        writer.SetFileName(str(tmp_path / name))
        writer.Write()
        check_arrays(tmp_path / name)


def test_sizes_may_be_encoded_apart_and_text_broken_into_lines(tmp_path: Path) -> None:
    data = write(tmp_path / "a.vti", "i", "ZLib", "inline", "UInt64")
    lines = [
        b"\n".join(line[start : start + 76] for start in range(0, len(line), 76)) if b"<" not in line else line
        for line in data.split(b"\n")
    ]
    (tmp_path / "a.vti").write_bytes(b"\n".join(lines))
    check_arrays(tmp_path / "a.vti")


@pytest.mark.parametrize(("compressor", "mode", "size"), list(itertools.product(COMPRESSORS, MODES, SIZES)))
def test_bytes_lost_within_the_data_never_change_values(tmp_path: Path, compressor: str, mode: str, size: str) -> None:
    path = tmp_path / "a.vti"
    data = write(path, "i", compressor, mode, size)
    start = data.find(b"<AppendedData" if mode in ("raw", "base64") else b"<PointData")
    start = data.find(b">", start) + 1
    for place in np.linspace(start, data.rfind(b"</") - 80, 12).astype(int):
        path.write_bytes(data[:place] + data[place + 64 :])
        _same_or_refused(path)


@pytest.mark.parametrize(("compressor", "mode"), list(itertools.product(COMPRESSORS, MODES)))
@pytest.mark.parametrize(
    ("said", "lie"),
    [
        (b'WholeExtent="0 10 0 7 0 6"', b'WholeExtent="0 10 0 7 0 7"'),
        (b'Extent="0 10 0 7 0 6"', b'Extent="0 10 0 7 0 5"'),
        (b'"LittleEndian"', b'"BigEndian"'),
        (b'"BigEndian"', b'"LittleEndian"'),
    ],
)
def test_a_head_that_lies_is_refused(tmp_path: Path, compressor: str, mode: str, said: bytes, lie: bytes) -> None:
    path = tmp_path / "a.vti"
    data = write(path, "i", compressor, mode, "UInt32", int(said != b'"BigEndian"'))
    assert said in data
    if mode == "ascii" and b"Endian" in said:
        return  # text has none
    path.write_bytes(data.replace(said, lie))
    with pytest.raises(ValueError, match=r"pieces|array|VTK says"):
        read_field(path, array="t")


@pytest.mark.parametrize("compressor", COMPRESSORS)
@pytest.mark.parametrize("size", SIZES)
def test_sizes_of_blocks_that_lie_end_no_process(tmp_path: Path, compressor: str, size: str) -> None:
    path = tmp_path / "a.vti"
    data = write(path, "i", compressor, "raw", size)
    start = data.find(b"_", data.find(b"<AppendedData")) + 1
    width = 4 if size == "UInt32" else 8
    for place in range((1 if compressor == "None" else 5) * width):
        for bit in (1, 128):
            lie = bytearray(data)
            lie[start + place] ^= bit
            path.write_bytes(bytes(lie))
            _same_or_refused(path)


@pytest.mark.parametrize("value", [0.0, 1.5])
@pytest.mark.parametrize(("kind", "mode"), list(itertools.product(GRIDS, ("raw", "base64", "inline"))))
def test_another_type_of_sizes_is_refused(tmp_path: Path, kind: str, mode: str, value: float) -> None:
    """Of a constant field, too, whose zeros look like the other half of a size."""
    path = tmp_path / f"a.vt{kind}"
    for compressor, size, order in itertools.product(COMPRESSORS, SIZES, (0, 1)):
        data = write(path, kind, compressor, mode, size, order, value=value)
        check_arrays(path)
        said, other = (f'header_type="{name}"'.encode() for name in (size, *(set(SIZES) - {size})))
        for lie in {data.replace(said, other), data.replace(said, b"") if size == "UInt64" else data} - {data}:
            path.write_bytes(lie)
            with pytest.raises(ValueError, match="array '"):
                check_arrays(path)
    assert said in data


def _same_or_refused(path: Path) -> None:
    try:
        grid = read_field(path, array="t")
    except ValueError:
        return
    np.testing.assert_array_equal(grid.values, VALUES)
