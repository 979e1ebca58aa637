"""Xcompact3d's snapshots: the raw values, where they lie, and nothing outside their folder."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insitu.readers.files import read_data, read_field
from insitu.readers.reader import Sampling
from insitu.readers.states import dumps_below, reader_for, table_of_files, with_states
from insitu.readers.xcompact3d import recognizes
from tests.support.damage import damaged, memory_at_most, read_or_refused
from tests.support.xcompact3d_files import write_snapshot

VALUES = np.random.default_rng(0).normal(size=(4, 5, 6))  # z, y, x
EVEN = [0.1 * np.arange(6), np.arange(5) / 3, 1e-3 * np.arange(4)]
STRETCHED = [EVEN[0], np.array([0.0, 0.1, 0.3, 0.6, 1.0]), EVEN[2]]


def snapshot(folder: Path, number: int = 10, kind: str = "<f8") -> Path:
    return write_snapshot(folder / "data", number, {"ux": VALUES, "pp": -VALUES}, EVEN, kind=kind)


@pytest.mark.parametrize("kind", ["<f8", "<f4", ">f8", ">f4"])
def test_the_values_are_the_files(tmp_path: Path, kind: str) -> None:
    path = snapshot(tmp_path, kind=kind)
    found = read_data(path, array="ux")
    assert found.values.dtype == np.dtype(kind)
    assert np.array_equal(found.values, VALUES.astype(kind))
    assert found.spacing == (0.1, 1 / 3, 1e-3)
    assert found.origin == (0, 0, 0)
    grid = read_field(path, array="pp")
    assert np.array_equal(grid.values, -VALUES.astype(kind))
    with pytest.raises(ValueError, match=r"name the array to render .*: snapshot '0010' has ux, pp"):
        read_data(path)


def test_a_stretched_mesh_has_its_coordinates(tmp_path: Path) -> None:
    path = write_snapshot(tmp_path, 1, {"ux": VALUES}, STRETCHED)
    found = read_data(path)
    assert np.array_equal(found.values, VALUES)
    for letter, axis in zip("xyz", STRETCHED, strict=True):
        assert np.array_equal(found.coords[letter], axis)
    assert "unevenly spaced" in read_field(path).notes[0]


def test_snapshots_are_told_apart_by_their_numbers(tmp_path: Path) -> None:
    for number in (1, 2, 10):
        snapshot(tmp_path, number)
    table = table_of_files(dumps_below(tmp_path / "data"))
    reader = reader_for([row.path for row in table.rows])
    assert reader is not None
    assert reader.name == "xcompact3d"
    rows = with_states(table, reader, Sampling()).rows
    assert [dict(row.parameters) for row in rows] == [{"snapshot": 1.0}, {"snapshot": 2.0}, {"snapshot": 10.0}]


SERIES = """<Xdmf Version="2.0"><Domain>
<Topology name="topo" TopologyType="3DCoRectMesh" Dimensions="4 5 6"/>
<Geometry name="geo" Type="ORIGIN_DXDYDZ">
<DataItem Format="XML" Dimensions="3">0.0 0.0 0.0</DataItem><DataItem Format="XML" Dimensions="3">3 2 1</DataItem>
</Geometry>
<Grid Name="TimeSeries" GridType="Collection" CollectionType="Temporal">
<Time TimeType="HyperSlab"><DataItem Format="XML" NumberType="Float" Dimensions="3">
<!--Start, Stride, Count--> 0.0 0.25 </DataItem></Time>
{grids}</Grid></Domain></Xdmf>
"""
GRID = """<Grid Name="{n:03d}" GridType="Uniform"><Topology Reference="/Xdmf/Domain/Topology[1]"/>
<Geometry Reference="/Xdmf/Domain/Geometry[1]"/><Attribute Name="ux" Center="Node"><DataItem Format="Binary"
DataType="Float" Precision="8" Endian="little" Seek="8" Dimensions="4 5 6">./data/ux-{n:03d}.bin</DataItem></Attribute></Grid>
"""


def series(folder: Path) -> Path:
    """All snapshots in one file, as the code's toolbox writes them."""
    (folder / "data").mkdir()
    for n in range(3):
        np.append(99.0, n * VALUES).tofile(folder / f"data/ux-{n:03d}.bin")
    path = folder / "snapshots.xdmf"
    path.write_text(SERIES.format(grids="".join(GRID.format(n=n) for n in range(3))))
    return path


def test_an_array_of_cells_has_no_value_for_each_point(tmp_path: Path) -> None:
    path = series(tmp_path)
    path.write_text(path.read_text().replace('Center="Node"', 'Center="Cell"'))
    with pytest.raises(ValueError, match=r"ux has \(4, 5, 6\) values on \(3, 4, 5\) cells"):
        read_data(path, index=(0,))


def test_a_file_may_hold_all_snapshots_and_their_times(tmp_path: Path) -> None:
    path = series(tmp_path)
    assert recognizes(path)
    reader = reader_for([path])
    assert reader is not None
    rows = with_states(table_of_files([path]), reader, Sampling(), ["time"]).rows
    assert [(dict(row.parameters), row.index) for row in rows] == [({"time": 0.25 * n}, (n,)) for n in range(3)]
    found = read_data(path, index=(2,))
    assert np.array_equal(found.values, 2 * VALUES)
    assert (found.spacing, found.time) == ((1, 2, 3), 0.5)
    with pytest.raises(ValueError, match="it has 3 snapshots, not 4"):
        read_data(path, index=(3,))


def test_the_codes_toolbox_writes_what_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    toolbox = pytest.importorskip("xcompact3d_toolbox", reason="xcompact3d-toolbox (400 MB) is not installed")
    monkeypatch.chdir(tmp_path)
    run = toolbox.Parameters(nx=17, ny=9, nz=9, xlx=4.0, yly=2.0, zlz=2.0, dt=0.1, ioutput=2, ilast=4)
    run.dataset.set(data_path="./data/")
    run.dataset.filename_properties.set(number_of_digits=3)
    fields = {n: np.random.default_rng(n).random((9, 9, 17)).astype(toolbox.param["mytype"]) for n in range(3)}
    (tmp_path / "data").mkdir()
    for n, values in fields.items():
        values.tofile(tmp_path / f"data/ux-{n:03d}.bin")
    run.dataset.write_xdmf("snapshots.xdmf")
    theirs = run.dataset.load_array("./data/ux-001.bin", add_time=False)
    found = read_data(tmp_path / "snapshots.xdmf", index=(1,))
    assert np.array_equal(found.values, theirs.transpose("z", "y", "x").values)
    assert found.spacing == pytest.approx((0.25, 0.25, 0.25))
    assert found.time == pytest.approx(0.2)


BOMB = '<?xml version="1.0"?>\n<!DOCTYPE Xdmf [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "{b}">]>\n<Xdmf>&b;</Xdmf>'


def bomb(path: Path) -> None:
    marks = '<!-- TopologyType="3DRectMesh" "Binary" -->'
    path.write_text(BOMB.format(b="&a;" * 1000) + marks)


def outside(path: Path) -> None:
    (path.parent.parent / "secret.bin").write_bytes(bytes(960))
    path.write_text(path.read_text().replace("././ux-0010.bin", "../secret.bin"))


def by_link(path: Path) -> None:
    (path.parent.parent / "secret.bin").write_bytes(bytes(960))
    (path.parent / "ux-0010.bin").unlink()
    (path.parent / "ux-0010.bin").symlink_to(path.parent.parent / "secret.bin")


def by_pipe(path: Path) -> None:
    (path.parent / "ux-0010.bin").unlink()
    os.mkfifo(path.parent / "ux-0010.bin")


def replaced(old: str, new: str, path: Path) -> None:
    path.write_text(path.read_text().replace(old, new))


COUNTS = f'"{4:12d}{5:12d}{6:12d}"'
HOSTILE = [
    (bomb, "declares an entity"),
    (outside, "outside the folder"),
    (by_link, "outside the folder"),
    (by_pipe, "there is no file"),
    (lambda path: replaced("././ux-0010.bin", "/etc/hostname", path), "outside the folder"),
    (lambda path: replaced("././ux-0010.bin", "", path), "there is no file"),
    (lambda path: replaced("././ux-0010.bin", "a" * 5000, path), "ux: .*(not readable|no file)"),
    (lambda path: replaced('Seek="0"', 'Seek="16"', path), "claims 976 bytes, ux-0010.bin has 960"),
    (lambda path: replaced('Precision="8"', 'Precision="16"', path), "Float of 4 or 8 bytes, got Float 16"),
    (lambda path: replaced(COUNTS, '"99999999 99999999 99999999"', path), "claims 7999999760000002399999992 bytes"),
    (lambda path: replaced(COUNTS, '"4 5"', path), "Dimensions must be three numbers"),
    (
        lambda path: (
            replaced('Dimensions="3"', 'Dimensions="2"', path).__class__ and replaced("0.0 0.0 0.0", "0.0", path)
        ),
        "geometry",
    ),
    (
        lambda path: replaced("0.0 0.0 0.0", "0.0 nan 0.0", path),
        "origin and spacing must be a finite number, got 'nan'",
    ),
    (lambda path: replaced('Format="Binary"', 'Format="HDF"', path), "stored as 'HDF'.*name its .bp folder"),
    (lambda path: path.write_text("<Xdmf>" * 100), "it nests more than 32 elements"),
    (lambda path: path.write_text("no XML at all"), "it is not XML"),
]


@pytest.mark.parametrize(("harm", "message"), HOSTILE)
def test_a_hostile_file_is_one_error(tmp_path: Path, harm: object, message: str) -> None:
    path = snapshot(tmp_path)
    harm(path)  # type: ignore[operator]
    with memory_at_most(8 << 20), pytest.raises(ValueError, match=message) as caught:
        read_data(path, array="ux", reader="xcompact3d")
    assert str(path) in str(caught.value)


@pytest.mark.slow
@settings(max_examples=200)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = snapshot(Path(name))
        path.write_bytes(data.draw(damaged(path.read_bytes())))
        found = read_or_refused(lambda: read_data(path, array="ux", reader="xcompact3d"), path)
        assert found is None or found.values.ndim == 3
