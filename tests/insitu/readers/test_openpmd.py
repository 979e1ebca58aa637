"""openPMD in HDF5: places, times and values are the file's numbers in SI units, whatever the order of its axes."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings

from catalogs.store.catalog import Catalog
from insitu.cli import main
from insitu.readers.codes import reader_of
from insitu.readers.files import read_data, read_field
from insitu.readers.openpmd import READER
from insitu.readers.reader import Sampling
from insitu.readers.states import dumps_below, table_of_files, with_states
from tests.support.damage import damaged, read_or_refused
from tests.support.openpmd_files import field, write_openpmd

pytestmark = pytest.mark.usefixtures("prepared_workers")


def written(folder: Path, values: Any = None, number: int = 100, **about: Any) -> Path:
    return write_openpmd(folder / "a.h5", {number: {"rho": {"values": field() if values is None else values, **about}}})


@pytest.mark.parametrize(
    ("labels", "order", "axes"),
    [
        (("z", "y", "x"), "C", (0, 1, 2)),
        (("x", "y", "z"), "C", (2, 1, 0)),
        (("y", "x", "z"), "C", (1, 2, 0)),
        (("x", "y", "z"), "F", (0, 1, 2)),
        (("z", "y", "x"), "F", (2, 1, 0)),
    ],
)
def test_axes_are_those_of_the_labels(
    tmp_path: Path, labels: tuple[str, ...], order: str, axes: tuple[int, ...]
) -> None:
    path = written(tmp_path, field().transpose(axes), labels=labels, order=order, position={"x": 0.5, "z": 0.25})
    grid = read_field(path)
    assert np.array_equal(grid.values, field())
    assert grid.spacing == (1.0, 2.0, 3.0)
    assert grid.origin == (10.5, 20.0, 30.75)
    assert np.array_equal(read_field(path, spacing=(1, 2, 3)).values, grid.values)
    with pytest.raises(ValueError, match=r"leave spacing out; this one has spacing \(1.0, 2.0, 3.0\)"):
        read_field(path, spacing=(1, 2, 4))


def test_lengths_times_and_values_are_in_si_units(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    parts = {"x": field(1).astype("f4"), "y": field(2).astype("f4"), "z": (7, (4, 5, 6))}
    write_openpmd(path, {3: {"E": {"values": parts, "unit": 1e45, "gridUnitSI": 1e-6}}})
    with h5py.File(path, "a") as file:
        file["data/3"].attrs["timeUnitSI"] = 1e-15
    [state] = READER.records(path, Sampling())
    assert dict(state.says) == {"time": 3 * 0.5 * 1e-15, "iteration": 3.0}
    for name in ("E_y", "E/y"):
        found = read_data(path, array=name)
        assert np.array_equal(found.values, field(2).astype("f4").astype("f8") * 1e45)
        assert found.spacing == pytest.approx((1e-6, 2e-6, 3e-6), rel=1e-15)
        assert found.origin == pytest.approx((1e-5, 2e-5, 3e-5), rel=1e-15)
        assert (found.name, found.unit, found.time) == ("E_y", "kg m s^-3 A^-1", 1.5 * 1e-15)
    assert np.array_equal(read_data(path, array="E_z").values, np.full((4, 5, 6), 7 * 1e45))
    with pytest.raises(ValueError, match=r"name the array to render \(--array\): the file has E_x, E_y, E_z$"):
        read_data(path)


def test_every_iteration_of_one_or_many_files_is_a_state(tmp_path: Path) -> None:
    one = write_openpmd(tmp_path / "all.h5", {n: {"rho": {"values": field(n)}} for n in (20, 100, 3)})
    table = with_states(table_of_files([one]), READER, Sampling())
    assert [(row.index, dict(row.parameters)) for row in table.rows] == [
        ((3,), {"time": 1.5}),
        ((20,), {"time": 10.0}),
        ((100,), {"time": 50.0}),
    ]
    assert dict(table.units) == {"time": "s"}
    assert np.array_equal(read_data(one, index=(100,)).values, field(100))
    with pytest.raises(ValueError, match="it has 3 iterations, 3, 20, 100: make an ensemble of them"):
        read_data(one)
    with pytest.raises(ValueError, match="there is no iteration 4, it has 3, 20, 100"):
        read_data(one, index=(4,))
    folder = tmp_path / "diags"
    folder.mkdir()
    for n in (3, 20):
        write_openpmd(folder / f"openpmd_{n:06d}.h5", {n: {"rho": {"values": field(n)}}})
    table = with_states(table_of_files(dumps_below(folder)), READER, Sampling())
    assert [dict(row.parameters) for row in table.rows] == [{"time": 1.5}, {"time": 10.0}]


@pytest.mark.parametrize(
    ("about", "sentence"),
    [
        ({"geometry": np.bytes_("thetaMode")}, "rho: its geometry is 'thetaMode', and only a cartesian mesh"),
        ({"geometry": np.bytes_("cylindrical")}, "rho: its geometry is 'cylindrical'"),
        ({"labels": ("r", "t", "z")}, "rho: its axisLabels must be x, y and z"),
        ({"axisLabels": None}, "rho: its axisLabels must be x, y and z .* got \\[\\]"),
        ({"order": "K"}, "rho: its dataOrder must be C or F, got 'K'"),
        ({"gridSpacing": None}, "rho: its gridSpacing must be 3 finite numbers, or one, got none"),
        ({"gridSpacing": [1.0, 2.0]}, "rho: its gridSpacing must be 3 finite numbers"),
        ({"gridSpacing": [1.0, -2.0, 1.0]}, "rho: its gridSpacing and gridUnitSI must be positive"),
        ({"gridGlobalOffset": [np.nan, 0, 0]}, "rho: its gridGlobalOffset must be 3 finite numbers"),
        ({"values": field() * 1j}, "rho: its values must be real numbers, got complex128"),
        ({"values": (1.0, (1 << 40, 1 << 40, 8))}, "rho: its .* values claims .* GB, more than"),
        ({"values": field()[0], "labels": ("y", "x")}, "name the array to render .* the file has none"),
    ],
)
def test_other_meshes_are_refused(tmp_path: Path, about: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"a.h5: {sentence}"):
        read_data(written(tmp_path, **about))


@pytest.mark.parametrize(
    ("attributes", "sentence"),
    [
        ({"basePath": np.bytes_("/data/")}, "its basePath must end with %T, the number of an iteration, got '/data/'"),
        ({"basePath": np.bytes_("/other/%T/")}, "it has no iteration, such as /other/100/"),
        ({"meshesPath": np.bytes_("meshes/")}, "the file has none"),
    ],
)
def test_a_file_without_meshes_is_refused(tmp_path: Path, attributes: dict[str, Any], sentence: str) -> None:
    path = written(tmp_path)
    with h5py.File(path, "a") as file:
        file.attrs.update(attributes)
    with pytest.raises(ValueError, match=sentence):
        read_data(path)


def test_links_to_other_files_are_not_followed(tmp_path: Path) -> None:
    inner = written(tmp_path)
    path = write_openpmd(tmp_path / "b.h5", {100: {"E": {"values": field()}}})
    with h5py.File(path, "a") as file:
        file["data/200"] = h5py.ExternalLink(inner, "/data/100")
        file["data/100/fields/rho"] = h5py.ExternalLink(inner, "/data/100/fields/rho")
    assert [state.index for state in READER.records(path, Sampling())] == [(100,)]
    assert read_data(path).name == "E"


@pytest.mark.slow
def test_an_ensemble_renders_every_iteration(tmp_path: Path) -> None:
    path = write_openpmd(tmp_path / "all.h5", {n: {"rho": {"values": field(n)}} for n in (0, 1, 2)})
    look = tmp_path / "look.toml"
    look.write_text('[[appearance]]\nkind = "isosurface"\nname = "surface"\nisovalue = 0.5\n')
    catalog = str(tmp_path / "a.cdb")
    command = ["ensemble", str(path), "--catalog", catalog, "--appearance", str(look), "--size", "8", "--workers", "1"]
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 0, result.output
    assert [dict(m.parameters) for m in Catalog.open(catalog).members] == [{"time": 0.0}, {"time": 0.5}, {"time": 1.0}]
    assert Catalog.open(catalog).plan.space.parameters[0].unit == "s"


def _bytes() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return written(Path(folder)).read_bytes()


HEAD = _bytes()


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(damaged(HEAD, head=HEAD.index(field()[0, 0, 0].tobytes())))
def test_a_damaged_file_is_refused_or_read_as_it_was_written(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.h5")
        path.write_bytes(data)
        if reader_of(path) is READER:
            found = read_or_refused(lambda: read_data(path, array="rho"), path)
            assert found is None or found.values.shape == (4, 5, 6)
