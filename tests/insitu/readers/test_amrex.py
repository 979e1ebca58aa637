"""AMReX plotfiles: levels merged as the code means them, redshift from the job, and headers that are not believed."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insitu.fields.location import FieldLocation
from insitu.readers import amrex
from insitu.readers.amrex_header import is_plotfile, read_plotfile
from insitu.readers.files import read_data, read_field
from insitu.readers.reader import Sampling
from insitu.readers.states import dumps_below, reader_for, table_of_files, with_states
from tests.support.amrex_files import Box, boxes_of, merged, read_by_vtk, write_plotfile
from tests.support.damage import damaged, memory_at_most, read_or_refused

COUNTS = (8, 6, 16)  # x, y, z
BOXES: list[list[Box]] = [
    boxes_of((0, 0, 0), COUNTS, 4),
    [*boxes_of((4, 4, 0), (8, 4, 8), 4), *boxes_of((0, 8, 16), (6, 4, 16), 8)],
    boxes_of((10, 10, 2), (6, 4, 8), 2),
]
DOMAIN: dict[str, Any] = {"low": (-1.0, 0.0, 2.0), "high": (1.0, 3.0, 6.0), "time": 1.5}


def levels(count: int = 3) -> list[dict[str, np.ndarray]]:
    """Random numbers on every cell of every level, (z, y, x); few of them are stored."""
    random = np.random.default_rng(0)
    shapes = [tuple(n << level for n in COUNTS[::-1]) for level in range(count)]
    return [{name: random.normal(size=shape) for name in ("density", "Temp")} for shape in shapes]


def plotfile(folder: Path, count: int = 3, **how: Any) -> Path:
    return write_plotfile(folder / "plt00040", levels(count), BOXES[:count], **{**DOMAIN, **how})


def expected(count: int = 3, name: str = "Temp") -> np.ndarray:
    return merged([level[name] for level in levels(count)], BOXES[:count])


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", ">f4"])
def test_levels_are_merged_to_the_finest(tmp_path: Path, count: int, kind: str) -> None:
    path = plotfile(tmp_path, count, kind=kind)
    found = read_data(path, array="Temp")
    assert found.values.dtype == np.dtype(kind[1:])
    assert np.array_equal(found.values, expected(count).astype(kind[1:]))
    fine = 1 << (count - 1)
    assert found.spacing == pytest.approx((0.25 / fine, 0.5 / fine, 0.25 / fine))
    assert found.origin == pytest.approx((-1 + 0.125 / fine, 0.25 / fine, 2 + 0.125 / fine))
    assert found.time == 1.5


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", ">f4"])
def test_vtk_reads_the_same_plotfile(tmp_path: Path, count: int, kind: str) -> None:
    """The files that the tests write are held to VTK's own reading."""
    path = plotfile(tmp_path, count, kind=kind)
    assert np.array_equal(read_data(path, array="density").values, read_by_vtk(path, "density"))


@pytest.mark.parametrize("memory", [1, 8 * 32 * 24 * 6, 1 << 28])
@pytest.mark.parametrize(
    ("resolution", "level", "factors"),
    [((8, 6, 16), 0, (1, 1, 1)), ((16, 12, 32), 1, (1, 1, 1)), ((4, 2, 8), 0, (2, 3, 2)), ((32, 12, 32), 2, (1, 2, 2))],
)
def test_a_stated_resolution_is_a_level_or_its_means(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    memory: int,
    resolution: tuple[int, int, int],
    level: int,
    factors: Sequence[int],
) -> None:
    monkeypatch.setattr(amrex, "SLAB", memory)
    found = read_data(plotfile(tmp_path), array="Temp", sampling=Sampling(resolution))
    fine = expected(level + 1)
    kx, ky, kz = factors
    nz, ny, nx = fine.shape
    means = fine.reshape(nz // kz, kz, ny // ky, ky, nx // kx, kx).mean(axis=(1, 3, 5))
    assert np.allclose(found.values, means, rtol=0, atol=1e-14)
    grid = np.array(found.origin) - np.array(found.spacing) / 2
    assert grid == pytest.approx(DOMAIN["low"])


def test_what_cannot_be_had_is_told(tmp_path: Path) -> None:
    path = plotfile(tmp_path)
    with pytest.raises(
        ValueError, match="resolution 5 6 16 must divide the cells of a level, of which there are 8 6 16, 16"
    ):
        read_data(path, array="Temp", sampling=Sampling((5, 6, 16)))
    with pytest.raises(ValueError, match="no array 'T': the plotfile has density, Temp"):
        read_data(path, array="T")
    with pytest.raises(ValueError, match="leave spacing out"):
        read_data(path, array="Temp", location=FieldLocation(spacing=(1, 1, 1)))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_cells_may_be_numbered_from_anywhere(tmp_path: Path, count: int) -> None:
    assert np.array_equal(read_data(plotfile(tmp_path, count, start=-4), array="Temp").values, expected(count))


def test_dumps_of_a_job_are_told_apart_by_redshift(tmp_path: Path) -> None:
    for number, factor in enumerate((0.25, 0.5, 1.0)):
        path = plotfile(tmp_path, 1, comoving_a=factor, time=0.1 * number)
        path.rename(tmp_path / f"plt0000{number}")
    table = table_of_files(dumps_below(tmp_path))
    reader = reader_for([row.path for row in table.rows])
    assert reader is amrex.READER
    assert [dict(row.parameters) for row in with_states(table, reader, Sampling()).rows] == [
        {"redshift": 3.0},
        {"redshift": 1.0},
        {"redshift": 0.0},
    ]
    assert with_states(table, reader, Sampling(), ["time"]).names == ("time",)
    (tmp_path / "plt00001" / "comoving_a").write_text("0.0\n")
    damaged = with_states(table, reader, Sampling())
    assert [dict(row.parameters) for row in damaged.rows] == [{"redshift": 3.0}, {"redshift": 0.0}]
    ((_, reason),) = damaged.unread
    assert "plt00001: comoving_a must hold the scale factor, a positive number, got '0.0'" in reason


# ---- headers ---------------------------------------------------------------------------------------------------------


def edited(path: Path, name: str, old: str, new: str) -> None:
    text = (path / name).read_bytes()
    assert old.encode() in text
    (path / name).write_bytes(text.replace(old.encode(), new.encode(), 1))


def cut(path: Path) -> None:
    (path / "Level_1" / "Cell_D_00001").write_bytes((path / "Level_1" / "Cell_D_00001").read_bytes()[:-1])


def linked(path: Path) -> None:
    (path / "Level_0" / "Cell_D_00000").rename(path.parent / "away")
    (path / "Level_0" / "Cell_D_00000").symlink_to(path.parent / "away")


WRONG = [
    ("Header", "HyperCLaw-V1.1", "HyperCLaw", "its first line is not the version"),
    (
        "Header",
        "\n2\n",
        "\n200000000\n",
        "the number of fields must be a whole number from 1 to 100000, got '200000000'",
    ),
    ("Header", "\n2\n", "\n3\n", "the number of dimensions must"),
    ("Header", "Temp", "density", "2 fields must have names, each another"),
    ("Header", "\n3\n", "\n2\n", "fewer than 3 dimensions"),
    ("Header", "\n1.5\n", "\nnan\n", "the time must be 1 finite numbers"),
    ("Header", "\n2\n-1.0", "\n3\n-1.0", "domains of 4 levels"),
    ("Header", "1.0 3.0 6.0", "-1.0 3.0 6.0", "the domain from .* is empty"),
    ("Header", "2 2 ", "4 2 ", "the domain of level 1 is not 4 times that of level 0"),
    ("Header", "(7,5,15)", "(700000000,5,15)", "the domain of level 0 must hold cells, 2 to"),
    ("Header", "0.25 0.5 0.25", "0.25 0.5 0.2", "cells of level 0 are"),
    ("Header", "\n0\n0\n0 ", "\n1\n0\n0 ", "not Cartesian"),
    ("Header", "Level_0/Cell", "../plt00041/Level_0/Cell", "'Level_0/Cell' must follow"),
    ("Header", "1 6 1.5", "1 5 1.5", "must follow the boxes of level 1"),
    ("Header", "1 6 1.5", "1 600000000 1.5", "the number of boxes of level 1"),
    ("Level_0/Cell_H", "(16 0", "(15 0", "components, no ghost cells and 16 boxes, as Header says"),
    ("Level_0/Cell_H", "\n2\n0\n", "\n2\n1\n", "no ghost cells"),
    ("Level_0/Cell_H", "((0,0,0) (3,3,3) (0,0,0))", "((0,0,0) (3,3,3) (1,0,0))", "box 0 must hold cells"),
    ("Level_0/Cell_H", "((0,0,0) (3,3,3) (0,0,0))", "((0,0,0) (3,3,99) (0,0,0))", "is empty or leaves the domain"),
    ("Level_0/Cell_H", "((0,0,0) (3,3,3) (0,0,0))", "((0,0,0) (3,3,2) (0,0,0))", "do not begin|does not begin"),
    ("Level_0/Cell_H", "Cell_D_00000 0", "../Cell_D_00000 0", "where box 0 lies must follow"),
    ("Level_0/Cell_H", "Cell_D_00001 0", "Cell_D_00001 9", "box 1 does not begin at byte 9"),
    ("Level_0/Cell_H", "Cell_D_00001 0", "Cell_D_00007 0", "there is no such file"),
    ("Level_0/Cell_D_00000", "(8 7 6 5 4 3 2 1)", "(7 8 5 6 3 4 1 2)", "IEEE numbers"),
    ("Level_2/Cell_D_00001", "(8 7 6 5 4 3 2 1)", "(1 2 3 4 5 6 7 8)", "numbers of several kinds"),
]


@pytest.mark.parametrize(("name", "old", "new", "message"), WRONG)
def test_a_header_that_lies_is_one_error(tmp_path: Path, name: str, old: str, new: str, message: str) -> None:
    path = plotfile(tmp_path)
    edited(path, name, old, new)
    with memory_at_most(1 << 20), pytest.raises(ValueError, match=message) as caught:
        read_data(path, array="Temp", reader="amrex")
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (cut, "Level_1/Cell_D_00001: box 5 ends behind the file's"),
        (linked, "Level_0/Cell_D_00000: there is no such file in the plotfile"),
        (lambda path: shutil.rmtree(path / "Level_2"), "Cell_H"),
    ],
)
def test_a_plotfile_that_is_not_whole_is_one_error(tmp_path: Path, harm: Any, message: str) -> None:
    path = plotfile(tmp_path)
    harm(path)
    with pytest.raises(ValueError, match=message):
        read_data(path, array="Temp")


def test_boxes_that_overlap_do_not_fill_the_domain(tmp_path: Path) -> None:
    boxes = [*BOXES[0][:-1], BOXES[0][0]]
    assert boxes[-1] != BOXES[0][-1]
    path = write_plotfile(tmp_path / "plt1", levels(1), [boxes])
    with pytest.raises(ValueError, match="do not fill the domain of 768 cells"):
        read_plotfile(path)


def test_surplus_or_absent_refinement_ratios_do_not_matter(tmp_path: Path) -> None:
    for number, ratios in enumerate(("2 2 2 2 ", "")):
        path = plotfile(tmp_path / str(number))
        edited(path, "Header", "\n2 2 \n", f"\n{ratios}\n")
        assert np.array_equal(read_field(path, array="Temp").values, expected())


def test_folders_of_other_kinds_are_no_plotfiles(tmp_path: Path) -> None:
    assert is_plotfile(plotfile(tmp_path))
    (tmp_path / "a" / "Level_0").mkdir(parents=True)
    (tmp_path / "a" / "Level_0" / "Cell_H").touch()
    (tmp_path / "a" / "Header").write_text("CheckPointVersion_1.0\n")
    assert not is_plotfile(tmp_path / "a")
    assert not is_plotfile(tmp_path)
    assert not is_plotfile(tmp_path / "plt00040" / "Header")


HEADERS = ["Header", "Level_0/Cell_H", "Level_1/Cell_H", "Level_0/Cell_D_00000"]


@pytest.mark.slow
@settings(max_examples=200)
@given(st.sampled_from(HEADERS), st.data())
def test_damaged_headers_are_understood_or_refused(name: str, data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = plotfile(Path(folder), 2)
        (path / name).write_bytes(data.draw(damaged((path / name).read_bytes(), 4000)))
        with memory_at_most(8 << 20):
            try:
                read_plotfile(path)
            except ValueError as error:
                assert str(error).startswith(("Header", "Level_", "its boxes")), error  # noqa: PT017 - or none


@settings(max_examples=20)
@given(st.sampled_from(HEADERS), st.data())
def test_a_damaged_plotfile_is_read_or_refused(name: str, data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = plotfile(Path(folder), 2)
        (path / name).write_bytes(data.draw(damaged((path / name).read_bytes(), 4000)))
        found = read_or_refused(lambda: read_data(path, array="Temp", reader="amrex"), path)
        assert found is None or found.values.ndim == 3
