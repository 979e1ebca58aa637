"""Stored ensembles: what the file says is what comes out, and a wrong file is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from insitu.readers.stored import StoredEnsemble


def write(path: Path, **changes: Any) -> np.ndarray:
    """A good file of three members, with changes; None leaves something out."""
    random = np.random.default_rng(0)
    field = random.random((3, 4, 5, 6)).astype(np.float16)
    data = {"field": field, "params": random.random((3, 2)), "split": np.array(["train", "train", "test"], dtype="S")}
    attributes = {
        "names": ["a", "b"],
        "lower": [0.0, 0.0],
        "upper": [1.0, 1.0],
        "spacing": [1, 2, 3],
        "origin": [0.5, 1, 2],
    }
    with h5py.File(path, "w") as file:
        for name, value in {**data, **{k: v for k, v in changes.items() if k in data}}.items():
            if value is not None:
                file[name] = value
        for name, value in {**attributes, **{k: v for k, v in changes.items() if k in attributes}}.items():
            if value is not None:
                file.attrs[name] = value
    return field


def test_fields_parameters_and_splits_are_the_files(tmp_path: Path) -> None:
    field = write(tmp_path / "a.h5")
    opened = StoredEnsemble.open(tmp_path / "a.h5")
    assert opened.space.names == ("a", "b")
    assert opened.splits == ("train", "train", "test")
    read = opened.read(1)["field"]
    assert np.array_equal(read.values, field[1].astype(np.float32))
    assert (read.spacing, read.origin) == ((1.0, 2.0, 3.0), (0.5, 1.0, 2.0))
    assert [m.split for m in opened.members(validation=1)].count("validation") == 1
    assert "3 members" in repr(opened)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"field": None}, "field"),
        ({"field": np.zeros((3, 4, 5))}, "axes"),
        ({"field": np.zeros((2, 4, 5, 6))}, "agree"),
        ({"field": np.zeros((3, 1, 5, 6))}, "2 values"),
        ({"field": np.zeros((3, 4, 5, 6), dtype="S3")}, "real numbers"),
        ({"params": np.full((3, 2), np.nan)}, "finite"),
        ({"names": ["a"]}, "names"),
        ({"names": ["a", "a"]}, "unique"),
        ({"upper": [0.0, 1.0]}, "bounds"),
        ({"spacing": None}, "spacing"),
        ({"split": np.array(["train", "tset", "test"], dtype="S")}, "tset"),
    ],
)
def test_a_wrong_file_is_named(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    write(tmp_path / "a.h5", **changes)
    with pytest.raises(ValueError, match=message) as caught:
        StoredEnsemble.open(tmp_path / "a.h5")
    assert "a.h5" in str(caught.value)


def test_no_file_and_no_hdf5_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        StoredEnsemble.open(tmp_path / "absent.h5")
    (tmp_path / "text.h5").write_text("hello")
    with pytest.raises(ValueError, match="HDF5"):
        StoredEnsemble.open(tmp_path / "text.h5")


def test_the_real_ensemble_opens(shared_data: Path) -> None:
    opened = StoredEnsemble.open(shared_data / "cloverleaf3d_energy_64.h5")
    assert len(opened) == 120
    assert opened.splits.count("train") == 100
    assert len(opened.space) == 6
