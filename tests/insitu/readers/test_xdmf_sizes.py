"""XDMF files with and without times, and the sizes that they claim of their arrays."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from insitu.readers.files import read_field

VALUES = np.arange(480.0).reshape(6, 8, 10).astype("f4")  # [z, y, x]
TOPOLOGY = '<Topology TopologyType="3DSMesh" Dimensions="6 8 10"/>'


def write(path: Path, item: str, *, head: str = "", time: str = "", geometry: str = "") -> None:
    geometry = geometry or (
        '<Topology TopologyType="3DCoRectMesh" Dimensions="6 8 10"/><Geometry GeometryType="ORIGIN_DXDYDZ">'
        '<DataItem Dimensions="3" Format="XML">3 2 1</DataItem><DataItem Dimensions="3" Format="XML">0.3 0.2 0.1</DataItem>'
        "</Geometry>"
    )
    path.write_text(
        f'<?xml version="1.0" ?>{head}<Xdmf Version="2.0"><Domain><Grid Name="m" GridType="Uniform">{time}{geometry}'
        f'<Attribute Name="t" AttributeType="Scalar" Center="Node">{item}</Attribute></Grid></Domain></Xdmf>'
    )


def hdf(text: str, dimensions: str = "6 8 10") -> str:
    return f'<DataItem Dimensions="{dimensions}" NumberType="Float" Precision="4" Format="HDF">{text}</DataItem>'


@pytest.mark.parametrize("suffix", [".xdmf", ".xmf", ".xdmf3"])
@pytest.mark.parametrize("head", ["", '<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>'])
@pytest.mark.parametrize("time", ["", '<Time Value="2"/>'])
def test_a_single_grid_is_read_with_or_without_a_time(tmp_path: Path, suffix: str, head: str, time: str) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = VALUES
    write(tmp_path / f"a{suffix}", hdf("a.h5:/t"), head=head, time=time)
    grid = read_field(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(grid.values, VALUES)
    np.testing.assert_allclose(grid.origin, (1, 2, 3))
    np.testing.assert_allclose(grid.spacing, (0.1, 0.2, 0.3))


STORED = {
    "double": (VALUES.astype("f8"), ""),
    "in a row": (VALUES.ravel(), ""),
    "with an axis of one value": (VALUES[None], ""),
    "shorter": (VALUES[:4], "it claims 6 x 8 x 10 values, a.h5:/t has 4 x 8 x 10"),
    "longer": (np.concatenate([VALUES, VALUES]), "it claims 6 x 8 x 10 values, a.h5:/t has 12 x 8 x 10"),
    "transposed": (VALUES.T, "it claims 6 x 8 x 10 values, a.h5:/t has 10 x 8 x 6"),
}


@pytest.mark.parametrize("how", STORED)
def test_an_array_has_the_shape_that_is_claimed(tmp_path: Path, how: str) -> None:
    values, message = STORED[how]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = values
    write(tmp_path / "a.xdmf", hdf("a.h5:/t"))
    if message:
        with pytest.raises(ValueError, match=message):
            read_field(tmp_path / "a.xdmf")
    else:
        np.testing.assert_array_equal(read_field(tmp_path / "a.xdmf").values, VALUES)


@pytest.mark.parametrize("end", [100, 2500, -1])
def test_a_file_of_arrays_that_is_cut_is_named(tmp_path: Path, end: int) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = VALUES
    write(tmp_path / "a.xdmf", hdf("a.h5:/t"))
    (tmp_path / "a.h5").write_bytes((tmp_path / "a.h5").read_bytes()[:end])
    with pytest.raises(ValueError, match=r"a\.xdmf: a\.h5 can't be read"):
        read_field(tmp_path / "a.xdmf")


@pytest.mark.parametrize(
    ("text", "message"), [("b.h5:/t", "there is no file b.h5"), ("a.h5:/u", "there is no array /u")]
)
def test_an_absent_array_is_named(tmp_path: Path, text: str, message: str) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = VALUES
    write(tmp_path / "a.xdmf", hdf(text))
    with pytest.raises(ValueError, match=message):
        read_field(tmp_path / "a.xdmf")


@pytest.mark.parametrize(("count", "message"), [(480, ""), (300, "its text has 300"), (481, "its text has 481")])
def test_numbers_in_the_text_are_counted(tmp_path: Path, count: int, message: str) -> None:
    numbers = " ".join(str(float(n)) for n in range(count))
    write(tmp_path / "a.xdmf", f'<DataItem Dimensions="6 8 10" NumberType="Float" Format="XML">{numbers}</DataItem>')
    if message:
        with pytest.raises(ValueError, match=message):
            read_field(tmp_path / "a.xdmf")
    else:
        np.testing.assert_array_equal(read_field(tmp_path / "a.xdmf").values, VALUES)


@pytest.mark.filterwarnings("ignore::render.datasets.ResamplingWarning")
@pytest.mark.parametrize("change", [-4, 0, 4])
def test_raw_files_of_a_curved_mesh_have_as_many_bytes_as_claimed(tmp_path: Path, change: int) -> None:
    z, y, x = np.indices(VALUES.shape)
    points = np.stack([x + 0.1 * y, y, z], axis=-1).astype("f4")
    held = {"t.bin": VALUES.tobytes(), "p.bin": points.tobytes()}
    held["t.bin"] = held["t.bin"][:change] if change < 0 else held["t.bin"] + bytes(change)
    for name, data in held.items():
        (tmp_path / name).write_bytes(data)
    raw = '<DataItem Dimensions="{}" NumberType="Float" Precision="4" Format="Binary" Endian="Little">{}</DataItem>'
    geometry = f'{TOPOLOGY}<Geometry GeometryType="XYZ">{raw.format("6 8 10 3", "p.bin")}</Geometry>'
    write(tmp_path / "a.xmf", raw.format("6 8 10", "t.bin"), geometry=geometry)
    if change:
        with pytest.raises(ValueError, match=f"claims 1920 bytes, t.bin has {1920 + change}"):
            read_field(tmp_path / "a.xmf")
    else:
        grid = read_field(tmp_path / "a.xmf")
        known = grid.values if grid.holes is None else grid.values[~grid.holes]
        np.testing.assert_allclose([known.min(), known.max()], [0, 479], atol=1e-2)


@pytest.mark.parametrize(
    ("center", "counts", "message"),
    [
        ("Node", (6, 8, 10), ""),
        ("Cell", (5, 7, 9), ""),
        ("Cell", (6, 8, 10), r"array 't' claims 6 x 8 x 10 values, its grid of 6 x 8 x 10 points has 315 cells"),
        ("Node", (5, 7, 9), r"array 't' claims 5 x 7 x 9 values, its grid of 6 x 8 x 10 points has 480 nodes"),
    ],
)
def test_an_array_has_a_value_for_each_point_or_cell(
    tmp_path: Path, center: str, counts: tuple[int, ...], message: str
) -> None:
    values = VALUES[: counts[0], : counts[1], : counts[2]]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = values
    write(tmp_path / "a.xdmf", hdf("a.h5:/t", " ".join(map(str, counts))))
    (tmp_path / "a.xdmf").write_text((tmp_path / "a.xdmf").read_text().replace('"Node"', f'"{center}"'))
    if message:
        with pytest.raises(ValueError, match=message):
            read_field(tmp_path / "a.xdmf")
    else:
        np.testing.assert_array_equal(read_field(tmp_path / "a.xdmf").values, values)
