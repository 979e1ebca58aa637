"""NRRD and MetaImage: the values that were written, in their place, of every encoding; or one error."""

from __future__ import annotations

import bz2
import gzip
import zlib
from pathlib import Path

import numpy as np
import pytest
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from insitu.readers.files import read_field

VALUES = np.random.default_rng(0).random((9, 8, 11)).astype("f4")  # [z, y, x]
RAW, BIG = VALUES.tobytes(), VALUES.astype(">f4").tobytes()
TEXT = b" ".join(b"%.9g" % value for value in VALUES.ravel())
N = "NRRD0004\n# a remark\ntype: float\ndimension: 3\nsizes: 11 8 9\n{}\n"
M = "ObjectType = Image\nNDims = 3\nDimSize = 11 8 9\nElementSpacing = 2 3 4\nOffset = 1 2 3\nElementType = MET_FLOAT\n{}\n"
LOCAL = "ElementDataFile = LOCAL"
TURNED = VALUES.transpose(2, 1, 0)  # the first axis along z


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "x.raw").write_bytes(RAW)
    (tmp_path / "x.raw.gz").write_bytes(gzip.compress(RAW))
    (tmp_path / "headed.raw").write_bytes(b"12345678" + RAW)
    (tmp_path / "lines.raw").write_bytes(b"a\nb\n" + RAW)
    for number in range(9):
        (tmp_path / f"slice{number:02d}.raw").write_bytes(VALUES[number].tobytes())
    return tmp_path


LIST = "".join(f"slice{number:02d}.raw\n" for number in range(9))


@pytest.mark.parametrize(
    ("name", "head", "data"),
    [
        ("a.nrrd", "endian: little\nencoding: raw\n", RAW),
        ("a.nrrd", "endian: big\nencoding: raw\n", BIG),
        ("a.nrrd", "endian: little\nencoding: gzip\n", gzip.compress(RAW)),
        ("a.nrrd", "endian: big\nencoding: gz\nkey:=value\n", gzip.compress(BIG)),
        ("a.nrrd", "endian: big\nencoding: bzip2\n", bz2.compress(BIG)),
        ("a.nrrd", "encoding: ascii\n", TEXT),
        ("a.nhdr", "endian: little\nencoding: raw\ndata file: x.raw\n", b""),
        ("a.nhdr", "endian: little\nencoding: gzip\ndatafile: x.raw.gz\n", b""),
        ("a.nhdr", "endian: little\nencoding: raw\nbyte skip: 8\ndata file: headed.raw\n", b""),
        ("a.nhdr", "endian: little\nencoding: raw\nbyte skip: -1\ndata file: headed.raw\n", b""),
        ("a.nhdr", "endian: little\nencoding: raw\nline skip: 2\ndata file: lines.raw\n", b""),
        ("a.nhdr", f"endian: little\nencoding: raw\ndata file: LIST\n{LIST}", b""),
        ("a.nhdr", "endian: little\nencoding: raw\ndata file: slice%02d.raw 0 8 1\n", b""),
        ("a.mha", LOCAL, RAW),
        ("a.mha", f"BinaryDataByteOrderMSB = True\n{LOCAL}", BIG),
        ("a.mha", f"ElementByteOrderMSB = True\n{LOCAL}", BIG),
        ("a.mha", f"CompressedData = True\n{LOCAL}", zlib.compress(RAW)),
        ("a.mha", f"CompressedData = True\nElementByteOrderMSB = True\n{LOCAL}", zlib.compress(BIG)),
        ("a.mha", f"BinaryData = False\n{LOCAL}", TEXT),
        ("a.mha", f"ElementType = MET_FLOAT_ARRAY\n{LOCAL}", RAW),
        ("a.mhd", "ElementDataFile = x.raw", b""),
        ("a.mhd", "HeaderSize = 8\nElementDataFile = headed.raw", b""),
        ("a.mhd", "HeaderSize = -1\nElementDataFile = headed.raw", b""),
        ("a.mhd", f"ElementDataFile = LIST\n{LIST}", b""),
        ("a.mhd", "ElementDataFile = slice%02d.raw 0 8 1", b""),
    ],
)
def test_values_are_those_that_were_written(folder: Path, name: str, head: str, data: bytes) -> None:
    path = folder / name
    text = (N if name.startswith("a.n") else M).format(head).encode()
    path.write_bytes(text + data)
    grid = read_field(path)
    np.testing.assert_array_equal(grid.values, VALUES)
    assert np.allclose(grid.spacing, (1, 1, 1) if name.startswith("a.n") else (2, 3, 4))
    if not data:
        return
    for lost in (*((1, 4) if data != TEXT else ()), len(data) // 2, len(data) - 1):
        path.write_bytes(text + data[:-lost])
        with pytest.raises(ValueError, match=r"header claims|damaged"):
            read_field(path)


@pytest.mark.parametrize(
    ("name", "head", "spacing", "origin", "values"),
    [
        ("a.nrrd", "spacings: 2 3 4", (2, 3, 4), (0, 0, 0), VALUES),
        ("a.nrrd", "spacings: nan 3 4", (1, 3, 4), (0, 0, 0), VALUES),
        ("a.nrrd", "axis mins: 1 2 3\naxis maxs: 21 16 11", (2, 2, 1), (1, 2, 3), VALUES),
        ("a.nrrd", "space directions: (2,0,0) (0,3,0) (0,0,4)\nspace origin: (1,2,3)", (2, 3, 4), (1, 2, 3), VALUES),
        ("a.nrrd", "space directions: (0,0,4) (0,3,0) (2,0,0)\nspace origin: (1,2,3)", (2, 3, 4), (1, 2, 3), TURNED),
        ("a.nrrd", "space directions: (-2,0,0) (0,3,0) (0,0,4)", (2, 3, 4), (-20, 0, 0), VALUES[:, :, ::-1]),
        ("a.mha", "TransformMatrix = 1 0 0 0 1 0 0 0 1", (2, 3, 4), (1, 2, 3), VALUES),
        ("a.mha", "TransformMatrix = 0 0 1 0 1 0 1 0 0", (4, 3, 2), (1, 2, 3), TURNED),
        ("a.mha", "TransformMatrix = 1 0 0 0 1 0 0 0 -1", (2, 3, 4), (1, 2, 3 - 32), VALUES[::-1]),
    ],
)
def test_axes_stand_as_the_header_says(
    tmp_path: Path, name: str, head: str, spacing: tuple[float, ...], origin: tuple[float, ...], values: np.ndarray
) -> None:
    text = N.format(f"{head}\nencoding: raw\n") if name == "a.nrrd" else M.format(f"{head}\n{LOCAL}")
    (tmp_path / name).write_bytes(text.encode() + RAW)
    grid = read_field(tmp_path / name)
    np.testing.assert_array_equal(grid.values, values)
    assert np.allclose(grid.spacing, spacing)
    assert np.allclose(grid.origin, origin)


@pytest.mark.parametrize(
    ("name", "head", "match"),
    [
        ("a.nrrd", "space directions: (2,0,0) (1,3,0) (0,0,4)\nencoding: raw\n", "right angles"),
        ("a.nrrd", "space directions: (0,0,0) (0,3,0) (0,0,4)\nencoding: raw\n", "no step zero"),
        ("a.nrrd", "encoding: hex\n", "encoding 'hex' are not read"),
        ("a.nrrd", "", "lacks 'encoding'"),
        ("a.mha", f"TransformMatrix = 1 0 0 0.5 1 0 0 0 1\n{LOCAL}", "right angles"),
        ("a.mha", "ElementDataFile = absent.raw", "no file absent.raw"),
        ("a.mha", f"ElementType = MET_STRING\n{LOCAL}", "'MET_STRING' are not read"),
    ],
)
def test_what_is_not_read_is_one_error(tmp_path: Path, name: str, head: str, match: str) -> None:
    (tmp_path / name).write_bytes((N if name == "a.nrrd" else M).format(head).encode() + RAW)
    with pytest.raises(ValueError, match=match):
        read_field(tmp_path / name)


def test_turned_axes_are_said(tmp_path: Path) -> None:
    head = "space directions: (0.8,0.6,0) (-0.6,0.8,0) (0,0,1)\nencoding: raw\n"
    (tmp_path / "a.nrrd").write_bytes(N.format(head).encode() + RAW)
    with pytest.warns(UserWarning, match="turned"):
        np.testing.assert_array_equal(read_field(tmp_path / "a.nrrd").values, VALUES)


@pytest.mark.parametrize("kind", ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"])
@pytest.mark.parametrize("compressed", [False, True])
def test_a_meta_image_is_read_as_vtk_wrote_it(tmp_path: Path, kind: str, compressed: bool) -> None:
    made = vtk.vtkImageData()
    made.SetDimensions(11, 8, 9)
    made.SetSpacing(0.5, 1.0, 2.0)
    made.SetOrigin(1.0, 2.0, 3.0)
    made.AllocateScalars(vtk.util.numpy_support.get_vtk_array_type(np.dtype(kind)), 1)
    vtk_to_numpy(made.GetPointData().GetScalars())[:] = np.arange(792) % 100
    writer = vtk.vtkMetaImageWriter()
    writer.SetInputData(made)
    writer.SetFileName(str(tmp_path / "a.mhd"))
    writer.SetCompression(compressed)
    writer.Write()
    grid = read_field(tmp_path / "a.mhd")
    np.testing.assert_array_equal(grid.values.ravel(), np.arange(792) % 100)
    assert np.allclose(grid.spacing, (0.5, 1.0, 2.0))
    assert np.allclose(grid.origin, (1.0, 2.0, 3.0))
