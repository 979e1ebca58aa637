"""Formats of VTK that pyvista does not know by their suffix are read all the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista
import vtk

from insitu.readers.files import read_field
from tests.support.vtk_data import check, curved, halves, linear, refined, tree


def written(kind: type, data: object, path: Path) -> Path:
    writer = kind()
    writer.SetInputData(data)
    writer.SetFileName(str(path))
    assert writer.Write() == 1
    return path


@pytest.mark.parametrize("suffix", [".vthb", ".vtpc", ".htg"])
def test_a_linear_field(tmp_path: Path, suffix: str) -> None:
    made = {
        ".vthb": lambda: (vtk.vtkXMLUniformGridAMRWriter, refined()),
        ".vtpc": lambda: (vtk.vtkXMLPartitionedDataSetCollectionWriter, halves(vtk.vtkPartitionedDataSetCollection)),
        ".htg": lambda: (vtk.vtkXMLHyperTreeGridWriter, tree()),
    }[suffix]
    path = written(*made(), tmp_path / f"a{suffix}")
    grid = read_field(path, array="f")
    check(grid)
    with pytest.raises(ValueError, match="no array 'g'"):
        read_field(path, array="g")


@pytest.mark.parametrize("suffix", [".vthb", ".vtpc", ".htg"])
def test_one_that_is_cut_is_named(tmp_path: Path, suffix: str) -> None:
    test_a_linear_field(tmp_path, suffix)
    path = tmp_path / f"a{suffix}"
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ValueError, match="was it cut short"):
        read_field(path, array="f")


def test_pieces_of_a_structured_grid(tmp_path: Path) -> None:
    mesh = curved()
    mesh.point_data["f"] = linear(np.asarray(mesh.points, float))
    writer = vtk.vtkXMLPStructuredGridWriter()
    writer.SetInputData(mesh)
    writer.SetFileName(str(tmp_path / "a.pvts"))
    writer.SetNumberOfPieces(1)
    writer.Write()
    check(read_field(tmp_path / "a.pvts", array="f"))


def test_a_surface_is_refused(tmp_path: Path) -> None:
    sphere = pyvista.Sphere()
    sphere.point_data["f"] = np.arange(float(sphere.n_points))
    sphere.save(tmp_path / "a.vtp")
    with pytest.raises(
        ValueError, match=r"a\.vtp: the PolyData has no volume cells|a\.vtp: the vtkPolyData has no volume"
    ):
        read_field(tmp_path / "a.vtp", array="f")
