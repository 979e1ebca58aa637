"""Fields from loose files."""

from __future__ import annotations

import gzip
import io
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from insitu.readers.files import read_field


def test_npy_and_vtk_hold_the_same(tmp_path: Path) -> None:
    import pyvista

    values = np.random.default_rng(0).random((4, 5, 6)).astype(np.float32)
    np.save(tmp_path / "a.npy", values)
    mesh = pyvista.ImageData(dimensions=(6, 5, 4), spacing=(1.0, 2.0, 3.0))
    mesh["pressure"], mesh["other"] = values.ravel(), values.ravel() + 1
    mesh.save(tmp_path / "a.vti")
    first = read_field(tmp_path / "a.npy", spacing=(1.0, 2.0, 3.0))
    second = read_field(tmp_path / "a.vti", array="pressure")
    assert np.array_equal(first.values, values)
    assert np.array_equal(second.values, values)
    assert first.spacing == second.spacing == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("name", ["text.npy", "text.vti", "unknown.xyz123", "flat.npy"])
def test_a_wrong_file_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name == "flat.npy":
        np.save(path, np.zeros((3, 3)))
    else:
        path.write_text("no field at all")
    with pytest.raises(ValueError, match=name.replace(".", r"\.")):
        read_field(path, spacing=(1.0, 1.0, 1.0) if path.suffix == ".npy" else None)


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.npy")
    os.mkfifo(tmp_path / "a.h5")
    for name in ("a.npy", "a.h5"):
        with pytest.raises(FileNotFoundError, match=name):
            read_field(tmp_path / name)


def test_an_absent_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="absent"):
        read_field(tmp_path / "absent.npy")


def test_pickles_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{"code": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match=r"(?i)pickle|python object"):
        read_field(tmp_path / "a.npy")


X, Y, Z = 0.5 + np.arange(6), 2.0 * np.arange(5), 3.0 * np.arange(4)
VALUES = (X + 10.0 * Y[:, None] + 100.0 * Z[:, None, None]).astype(np.float32)  # [z, y, x]
PLACE: dict[str, Any] = {"spacing": (1.0, 2.0, 3.0), "origin": (0.5, 0.0, 0.0)}


def mesh() -> Any:
    import pyvista

    made = pyvista.ImageData(dimensions=(6, 5, 4), **PLACE)
    made["f"] = VALUES.ravel()
    return made


def labelled() -> Any:
    xarray = pytest.importorskip("xarray")
    return xarray.Dataset({"f": (("z", "y", "x"), VALUES)}, coords={"x": X, "y": Y, "z": Z}).transpose("x", "z", "y")


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["f"] = VALUES
        file.attrs.update(**PLACE)


def gzipped(path: Path) -> None:
    mesh().save(path.with_suffix(""), binary=False)
    path.write_bytes(gzip.compress(path.with_suffix("").read_bytes()))


FORMATS: dict[str, Callable[[Path], Any]] = {
    "a.npz": lambda path: np.savez(path, f=VALUES, more=np.zeros(3), **PLACE),
    "a.h5": hdf5,
    "a.nc": lambda path: labelled().to_netcdf(path, engine="h5netcdf"),
    "a.zarr": lambda path: labelled().to_zarr(path, consolidated=False),
    "a.vti": lambda path: mesh().save(path),
    "a.vtr": lambda path: mesh().cast_to_rectilinear_grid().save(path),
    "a.vtk": lambda path: mesh().save(path),
    "a.vtm": lambda path: blocks(mesh()).save(path),
    "b.vtk.gz": gzipped,
}


def blocks(*of: Any) -> Any:
    import pyvista

    return pyvista.MultiBlock(list(of))


def halves() -> Any:
    """The image in two blocks, which share the points between them."""
    whole = mesh()
    return blocks(whole.extract_subset((0, 2, 0, 4, 0, 3)), whole.extract_subset((2, 5, 0, 4, 0, 3)))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("array", [None, "f"])
def test_every_format_holds_the_same_field(tmp_path: Path, name: str, array: str | None) -> None:
    FORMATS[name](tmp_path / name)
    grid = read_field(tmp_path / name, array=array)
    assert np.allclose(grid.values, VALUES)
    assert grid.spacing == pytest.approx(PLACE["spacing"])
    assert grid.origin == pytest.approx(PLACE["origin"])
    with pytest.raises(ValueError, match=f"{name}: .*'nothing'"):
        read_field(tmp_path / name, array="nothing")


@pytest.mark.parametrize("array", [None, "f"])
@pytest.mark.parametrize("name", ["a.vtu", "several.vtm"])
def test_meshes_and_blocks_are_sampled(tmp_path: Path, name: str, array: str | None) -> None:
    (mesh().cast_to_unstructured_grid() if name == "a.vtu" else halves()).save(tmp_path / name)
    grid = read_field(tmp_path / name, array=array)
    places = [o + s * np.arange(n) for o, s, n in zip(grid.origin, grid.spacing, grid.shape[::-1], strict=True)]
    z, y, x = np.meshgrid(*places[::-1], indexing="ij")
    assert np.allclose(grid.values, x + 10.0 * y + 100.0 * z, atol=1e-2)
    assert np.allclose(grid.bounds[1], (5.5, 8.0, 9.0))


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_axes_may_stand_in_another_order(tmp_path: Path, suffix: str) -> None:
    np.save(tmp_path / "a.npy", VALUES.transpose(2, 1, 0))
    np.savez(tmp_path / "a.npz", VALUES.transpose(2, 1, 0))
    grid = read_field(tmp_path / f"a{suffix}", dims=("x", "y", "z"), **PLACE)
    assert np.array_equal(grid.values, VALUES)
    assert grid.spacing == PLACE["spacing"]


def lying_npy(path: Path) -> None:
    np.save(path, VALUES)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"(4, 5, 6)", b"(9, 9, 9)"))


def huge_npy(path: Path) -> None:
    np.save(path, VALUES)
    path.write_bytes(path.read_bytes().replace(b"(4, 5, 6), }          ", b"(400000, 500000, 60),}"))


def lying_npz(path: Path) -> None:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"shape": (10**4, 10**4, 10), "fortran_order": False, "descr": "<f4"})
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("f.npy", head.getvalue() + bytes(100))


def huge_vti(path: Path) -> None:
    mesh().save(path)
    path.write_bytes(path.read_bytes().replace(b'WholeExtent="0 5 0 4 0 3"', b'WholeExtent="0 99999 0 99999 0 99999"'))


def huge_vtk(path: Path) -> None:
    path.write_text("# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 99999 99999 99999\n")


def truncated(path: Path) -> None:
    FORMATS[f"a{path.suffix}"](path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])


def pickled(path: Path) -> None:
    path.write_bytes(pickle.dumps({"a": 1}))


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("a.npy", lying_npy, "a.npy"),
        ("a.npy", huge_npy, "a.npy"),
        ("a.npz", lying_npz, "claims"),
        ("a.npz", truncated, "a.npz"),
        ("a.vti", huge_vti, "GB of memory that are free"),
        ("a.vtk", huge_vtk, "GB of memory that are free"),
        ("a.vti", truncated, "a.vti"),
        ("a.vtr", truncated, "a.vtr"),
        ("a.h5", truncated, "a.h5"),
        ("a.pkl", pickled, "run code"),
        ("a.vti.gz", pickled, "a.vti.gz"),
    ],
)
def test_a_hostile_file_is_one_error(tmp_path: Path, name: str, write: Callable[[Path], None], message: str) -> None:
    write(tmp_path / name)
    with pytest.raises(ValueError, match=message) as caught:
        read_field(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


def test_a_codes_own_dump_is_read(shared_data: Path) -> None:
    grid = read_field(shared_data / "clover.00001.00040.vtk.gz", array="energy")
    assert grid.shape == (64, 64, 64)
    with h5py.File(shared_data / "cloverleaf3d_energy_64.h5") as file:
        stored = file["field"][0].astype(np.float32)
    assert np.median(np.abs(grid.values - stored) / np.abs(stored).max()) < 1e-3
