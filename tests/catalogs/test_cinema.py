"""The table keeps specification D, and a table that doesn't is told where."""

from __future__ import annotations

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs import cinema

text = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=1, max_size=20)
cells = st.one_of(text, st.integers(-(2**60), 2**60), st.floats(allow_nan=False, allow_infinity=False))


@given(st.lists(st.lists(cells, min_size=3, max_size=3), min_size=1, max_size=8))
def test_tables_survive_an_independent_reader_and_our_own(rows: list[list[cinema.Cell]]) -> None:
    written = cinema.format_rows([["a", "b", "FILE"], *rows])
    wanted = [[cinema.format_cell(cell) for cell in row] for row in rows]
    assert list(csv.reader(io.StringIO(written, newline="")))[1:] == wanted
    assert cinema.parse(written) == (["a", "b", "FILE"], wanted)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_read_back_as_the_same_double_and_never_look_like_integers(value: float) -> None:
    cell = cinema.format_cell(value)
    assert float(cell) == value
    assert cinema.cell_type(cell) is float


@pytest.mark.parametrize(
    ("header", "problem"),
    [
        (["Re", "FILE"], None),
        (["Re", "FILE_depth", "FILE"], None),
        (["Re", "Re", "FILE"], "more than once"),
        (["Re", "", "FILE"], "no label"),
        (["FILE", "Re"], "last"),
        (["Re", "view"], "no column starts with FILE"),
        (["tf_profile", "FILE"], "profile"),
    ],
)
def test_labels(header: list[str], problem: str | None) -> None:
    found = cinema.header_problems(header)
    assert (not found) if problem is None else any(problem in sentence for sentence in found)


@pytest.mark.parametrize(
    ("column", "problem"),
    [
        (["1", "2"], None),
        (["1.0", "2.5e-3"], None),
        (["1", "2.0"], "row 3"),
        (["1.0", "nan"], "nan"),
        (["1.0", "inf"], "inf"),
        (["1", "x"], "mixes"),
        (["a", "b"], None),
    ],
)
def test_columns_have_one_type(column: list[str], problem: str | None) -> None:
    found = cinema.column_problems(["x", "FILE"], [[cell, "a.png"] for cell in column])
    assert (not found) if problem is None else any(problem in sentence for sentence in found)


@pytest.mark.parametrize("cell", ["", "/etc/passwd", "../a.png", "a/../../b.png", "a\\b.png", "a\x00.png"])
def test_paths_stay_inside(cell: str) -> None:
    assert cinema.column_problems(["x", "FILE"], [["1", cell]])


@pytest.mark.parametrize("table", ["", "\r\n", 'a,FILE\r\n"x,1\r\n', "a,FILE\r\n1\r\n", 'a,FILE\r\n1,"x"y\r\n'])
def test_what_is_no_table_is_refused(table: str) -> None:
    with pytest.raises(cinema.TableError):
        cinema.parse(table)


def test_a_truth_value_is_no_cell() -> None:
    with pytest.raises(cinema.TableError, match="word"):
        cinema.format_cell(True)
