"""Lists of files that name a box twice, or one another, and pieces that are named twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista

from insitu.readers.files import read_field


def image(path: Path, value: float, corner: float = 0.0) -> None:
    made = pyvista.ImageData(dimensions=(5, 6, 7), origin=(corner, 0, 0))
    made["q"] = np.full(made.n_points, value)
    made.save(path)


def collection(path: Path, *names: str) -> Path:
    rows = "".join(f'<DataSet timestep="1" part="0" file="{name}"/>' for name in names)
    path.write_text(f'<VTKFile type="Collection" version="0.1"><Collection>{rows}</Collection></VTKFile>')
    return path


def test_of_a_box_that_was_written_twice_the_later_is_taken_with_a_warning(tmp_path: Path) -> None:
    image(tmp_path / "a.vti", 1.0)
    image(tmp_path / "b.vti", 2.0)
    with pytest.warns(UserWarning, match=r"1 of 2 blocks fill the same box as a later one"):
        grid = read_field(collection(tmp_path / "a.pvd", "a.vti", "b.vti"))
    assert (grid.values == 2.0).all()


def test_boxes_beside_each_other_are_joined(tmp_path: Path) -> None:
    image(tmp_path / "a.vti", 1.0)
    image(tmp_path / "b.vti", 2.0, corner=4.0)
    assert read_field(collection(tmp_path / "a.pvd", "a.vti", "b.vti")).values.shape == (7, 6, 9)


def test_a_list_in_a_list_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"it names a\.pvd, which is a list of files itself"):
        read_field(collection(tmp_path / "a.pvd", "a.pvd"))


def test_a_piece_that_is_named_twice_is_refused(tmp_path: Path) -> None:
    image(tmp_path / "a.vti", 1.0)
    pyvista.read(tmp_path / "a.vti").cast_to_unstructured_grid().save(tmp_path / "a.vtu")
    (tmp_path / "a.pvtu").write_text(
        '<VTKFile type="PUnstructuredGrid" version="0.1" byte_order="LittleEndian"><PUnstructuredGrid GhostLevel="0"><PPointData>'
        '<PDataArray type="Float64" Name="q"/></PPointData><PPoints><PDataArray type="Float32" NumberOfComponents="3"/></PPoints>'
        '<Piece Source="a.vtu"/><Piece Source="a.vtu"/></PUnstructuredGrid></VTKFile>'
    )
    with pytest.raises(ValueError, match=r"it names a\.vtu for two of its pieces: is another one missing\?"):
        read_field(tmp_path / "a.pvtu")


def test_two_grids_of_one_box_in_a_file_are_said(tmp_path: Path) -> None:
    blocks = pyvista.MultiBlock()
    for value in (1.0, 2.0):
        made = pyvista.ImageData(dimensions=(5, 6, 7))
        made["q"], made["p"] = np.full(made.n_points, value), np.zeros(made.n_points)
        blocks.append(made)
    blocks.save(tmp_path / "a.vtm")
    with pytest.warns(UserWarning, match=r"1 of 2 blocks fill the same box as a later one"):
        assert (read_field(tmp_path / "a.vtm", array="q").values == 2.0).all()
    blocks[0].point_data.remove("q")
    blocks.save(tmp_path / "b.vtm")
    assert (read_field(tmp_path / "b.vtm", array="q").values == 2.0).all()
