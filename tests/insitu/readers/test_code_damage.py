"""Dumps of codes that went wrong in their structure: one error, or the values that were written; never others."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st

from insitu.readers.files import read_data
from tests.support.amrex_files import boxes_of, write_plotfile
from tests.support.athena_files import uniform, write_athena
from tests.support.cloverleaf_files import write_dump
from tests.support.damage import NUMBERS, read_or_refused
from tests.support.openpmd_files import write_openpmd
from tests.support.well_files import write_well
from tests.support.xcompact3d_files import write_snapshot

VALUES = np.random.default_rng(0).integers(-999, 999, (4, 6, 8)) / 1000  # z, y, x; as CloverLeaf can print them
CELLS = [np.arange(9.0), np.arange(7.0), np.arange(5.0)]
POINTS = [axis[:-1] for axis in CELLS]
STATE = {"well": (0, 0)}


def amrex(folder: Path) -> Path:
    level = {"u": VALUES, "v": -VALUES}
    return write_plotfile(folder / "plt1", [level], [boxes_of((0, 0, 0), (8, 6, 4), 4)])


def cloverleaf(folder: Path) -> Path:
    return write_dump(folder, 40, CELLS, {"u": VALUES, "v": -VALUES}, {}, ((3,), (2, 4), ()))[0]


def xcompact3d(folder: Path) -> Path:
    return write_snapshot(folder, 10, {"u": VALUES, "v": -VALUES}, POINTS)


def openpmd(folder: Path) -> Path:
    return write_openpmd(folder / "a.h5", {1: {name: {"values": VALUES} for name in "uv"}})


def athena(folder: Path) -> Path:
    return write_athena(folder / "a.athdf", uniform((2, 3, 1)))


def well(folder: Path) -> Path:
    write_well(folder / "a.hdf5", {"Ma": 0.7})
    return folder / "a.hdf5"


CODES = {"amrex": (amrex, "u"), "cloverleaf": (cloverleaf, "u"), "xcompact3d": (xcompact3d, "u")}
HDF5 = {"openpmd": (openpmd, "u"), "athena": (athena, "rho"), "well": (well, "density")}


def read(path: Path, code: str, array: str) -> np.ndarray:
    return np.array(read_data(path, array=array, reader=code, index=STATE.get(code, ())).values)


@st.composite
def damage(draw: st.DrawFn, path: Path, head: int) -> str:
    """Harm one of a dump's files in its structure: its numbers of sizes, its length, or all of its numbers' bytes."""
    files = sorted(file for file in ([path] if path.is_file() else path.rglob("*")) if file.is_file())
    files += sorted(file for file in path.parent.iterdir() if path.is_file() and file.is_file() and file != path)
    file = draw(st.sampled_from(files))
    data = file.read_bytes()
    kinds = ["cut", "append", "absent"]
    kinds += (
        ["swap"] if file.suffix == ".bin" else [] if file.name.startswith("Cell_D") else ["size", "twice", "without"]
    )
    kind = draw(st.sampled_from(kinds))
    lines = [0, *(match.end() for match in re.finditer(rb"\n", data[:head]))]
    if kind == "cut":
        file.write_bytes(data[: draw(st.one_of(st.integers(0, len(data) - 1), st.sampled_from(lines)))])
    elif kind == "append":
        file.write_bytes(data + draw(st.sampled_from([b"\n", b"0", bytes(8), data[-64:], data])))
    elif kind == "absent":
        file.unlink()
    elif kind == "size":
        found = [match.span() for match in re.finditer(rb"(?<![\d.+-])\d+(?![\d.E])", data[:head])] or [(0, 0)]
        begin, end = draw(st.sampled_from(found))
        file.write_bytes(data[:begin] + draw(st.sampled_from(NUMBERS)) + data[end:])
    elif kind == "swap":
        file.write_bytes(np.frombuffer(data, "f8").byteswap().tobytes())
    else:
        begin = draw(st.sampled_from(lines[:-1] or [0]))
        end = next((line for line in lines if line > begin), len(data))
        file.write_bytes(data[: begin if kind == "without" else end] + data[begin if kind == "twice" else end :])
    return f"{kind} {file.name}"


@pytest.mark.parametrize("code", CODES)
@settings(max_examples=120, deadline=None)
@given(data=st.data())
def test_what_is_accepted_is_what_was_written(code: str, data: st.DataObject) -> None:
    write, array = CODES[code]
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder))
        note(data.draw(damage(path, 3000)))
        found = read_or_refused(lambda: read(path, code, array), path) if path.exists() else None
        assert found is None or np.array_equal(found, VALUES)


@pytest.mark.parametrize("code", HDF5)
def test_hdf5_that_is_cut_anywhere_is_refused(code: str, tmp_path: Path) -> None:
    write, array = HDF5[code]
    path = write(tmp_path)
    data = path.read_bytes()
    assert read(path, code, array).size
    for end in range(0, len(data), max(1, len(data) // 40)):
        path.write_bytes(data[:end])
        with pytest.raises(ValueError, match=re.escape(str(path))):
            read(path, code, array)


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", ">f4"])
@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e15])
@pytest.mark.parametrize("shape", ["noise", "mostly zero", "whole numbers"])
def test_raw_numbers_in_another_order_of_bytes_are_refused(tmp_path: Path, kind: str, scale: float, shape: str) -> None:
    random = np.random.default_rng(0)
    values = {
        "noise": random.standard_normal((4, 6, 8)),
        "mostly zero": np.where(random.random((4, 6, 8)) < 0.9, 0, random.standard_normal((4, 6, 8))),
        "whole numbers": np.rint(100 * random.random((4, 6, 8))) / scale,
    }[shape] * scale
    path = write_snapshot(tmp_path, 10, {"u": values}, POINTS, kind=kind)
    assert np.array_equal(read(path, "xcompact3d", "u"), values.astype(kind))
    raw = tmp_path / "u-0010.bin"
    raw.write_bytes(np.fromfile(raw, kind).byteswap().tobytes())
    with pytest.raises(ValueError, match=r"u: the numbers of u-0010\.bin are in another order of bytes"):
        read(path, "xcompact3d", "u")
