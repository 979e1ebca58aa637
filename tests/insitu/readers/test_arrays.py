"""Files from strangers: nothing is read outside their folder, nothing is run, and no claim is believed."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from insitu.readers.arrays import open_arrays
from insitu.readers.stored import StoredEnsemble

FIELD = np.random.default_rng(0).random((3, 4, 4, 4)).astype(np.float32)


def good(file: h5py.File) -> None:
    file["params"] = [[0.0], [0.5], [1.0]]
    file.attrs.update(names=["a"], spacing=[1, 1, 1], lower=[0.0], upper=[1.0])


def external_storage(path: Path) -> None:
    secret = path.parent.parent / "secret"
    secret.write_bytes(FIELD.tobytes())
    with h5py.File(path, "w") as file:
        good(file)
        file.create_dataset("field", FIELD.shape, "f4", external=[(str(secret), 0, FIELD.nbytes)])


def virtual(path: Path) -> None:
    other = path.parent.parent / "other.h5"
    with h5py.File(other, "w") as file:
        file["field"] = FIELD
    with h5py.File(path, "w") as file:
        good(file)
        made = h5py.VirtualLayout(FIELD.shape, "f4")
        made[:] = h5py.VirtualSource(str(other), "field", FIELD.shape)
        file.create_virtual_dataset("field", made)


def external_link(path: Path) -> None:
    with h5py.File(path.parent.parent / "other.h5", "w") as file:
        file["field"] = FIELD
    with h5py.File(path, "w") as file:
        good(file)
        file["field"] = h5py.ExternalLink("../other.h5", "field")


def huge(path: Path) -> None:
    """A few bytes that claim 4 exabytes."""
    with h5py.File(path, "w") as file:
        good(file)
        file.create_dataset("field", (3, 10**6, 10**6, 10**6), "f4", chunks=(1, 64, 64, 64))


def truncated(path: Path) -> None:
    with h5py.File(path, "w") as file:
        good(file)
        file["field"] = np.random.default_rng(0).random((3, 32, 32, 32))
    path.write_bytes(path.read_bytes()[:-4000])


def text(path: Path) -> None:
    path.write_text("hello")


def code(file: h5py.File) -> None:
    """Opaque objects, which no reader may make."""
    file["field"] = np.array([pickle.dumps(FIELD)], dtype="V2000")


def opaque(path: Path) -> None:
    with h5py.File(path, "w") as file:
        good(file)
        code(file)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (external_storage, "outside the file's folder"),
        (virtual, "outside the file's folder"),
        (external_link, "there is no field"),
        (huge, "GB of memory that are free"),
        (truncated, "not readable as HDF5"),
        (text, "not readable as HDF5"),
        (opaque, "real numbers"),
    ],
)
def test_a_hostile_hdf5_is_one_error(tmp_path: Path, write: Callable[[Path], None], message: str) -> None:
    (tmp_path / "data").mkdir()
    path = tmp_path / "data" / "a.h5"
    write(path)
    with pytest.raises(ValueError, match=message) as caught:
        StoredEnsemble.open(path).read(0)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("write", [external_link, external_storage, virtual])
def test_a_hostile_netcdf_is_one_error(tmp_path: Path, write: Callable[[Path], None]) -> None:
    pytest.importorskip("xarray")
    (tmp_path / "data").mkdir()
    path = tmp_path / "data" / "a.nc"
    write(path)
    with pytest.raises(ValueError, match=r"outside the file's folder|is a link to"):
        StoredEnsemble.open(path)


class Touch:
    """Unpickling it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return Path.touch, (self.path,)


def pickled(path: Path, mark: Path) -> None:
    path.mkdir()
    about = {
        "zarr_format": 2,
        "shape": [1],
        "chunks": [1],
        "dtype": "|O",
        "compressor": None,
        "fill_value": None,
        "order": "C",
        "filters": [{"id": "pickle", "protocol": 5}],
    }
    (path / ".zgroup").write_text('{"zarr_format": 2}')
    (path / "x").mkdir()
    (path / "x" / ".zarray").write_text(json.dumps(about))
    (path / "x" / ".zattrs").write_text('{"_ARRAY_DIMENSIONS": ["x"]}')
    (path / "x" / "0").write_bytes(pickle.dumps(Touch(mark)))


def linked(path: Path, mark: Path) -> None:
    path.mkdir()
    (path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group", "attributes": {}}')
    (path / "x").symlink_to(path.parent.parent)


def unreadable(path: Path, mark: Path) -> None:
    path.mkdir()
    (path / "zarr.json").write_text("{" * 100_000)


@pytest.mark.parametrize(
    ("write", "message"), [(pickled, "could run code"), (linked, "link out of"), (unreadable, "a.zarr")]
)
def test_a_hostile_zarr_is_one_error(tmp_path: Path, write: Callable[[Path, Path], None], message: str) -> None:
    pytest.importorskip("zarr")
    path, mark = tmp_path / "a.zarr", tmp_path / "mark"
    write(path, mark)
    with pytest.raises(ValueError, match=message):
        StoredEnsemble.open(path)
    assert not mark.exists()


def test_a_virtual_data_set_of_files_beside_it_is_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "part.h5", "w") as file:
        file["field"] = FIELD
    with h5py.File(tmp_path / "a.h5", "w") as file:
        good(file)
        made = h5py.VirtualLayout(FIELD.shape, "f4")
        made[:] = h5py.VirtualSource("part.h5", "field", FIELD.shape)
        file.create_virtual_dataset("field", made)
    assert np.array_equal(StoredEnsemble.open(tmp_path / "a.h5").read(1)["field"].values, FIELD[1])


def test_what_a_file_holds_is_told(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        good(file)
        file["group/field"] = FIELD
    with open_arrays(tmp_path / "a.h5") as arrays:
        assert str(arrays).startswith("group/field float32 (3, 4, 4, 4), params float64 (3, 1); attributes")
        assert (arrays.arrays["group/field"].group, arrays.arrays["group/field"].stem) == ("group", "field")
    with pytest.raises(FileNotFoundError, match="absent"), open_arrays(tmp_path / "absent.h5"):
        pass
