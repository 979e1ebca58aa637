"""Fields from loose files."""

from __future__ import annotations

from pathlib import Path

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


def test_an_absent_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="absent"):
        read_field(tmp_path / "absent.npy")


def test_pickles_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{"code": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match=r"(?i)pickle|python object"):
        read_field(tmp_path / "a.npy")
