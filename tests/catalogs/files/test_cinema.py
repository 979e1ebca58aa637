"""The table follows specification D; errors name the place where a table does not."""

from __future__ import annotations

import csv
import io
import itertools
import re
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.files import cinema
from tests.support.damage import memory_at_most

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
    assert "." in cell
    assert cinema.cell_type(cell) is float


@pytest.mark.parametrize(
    ("header", "problem"),
    [
        (["Re", "FILE"], None),
        (["Re", "FILE_depth", "FILE"], None),
        (["Re", "Re", "FILE"], "more than once"),
        (["Re", "", "FILE"], "no label"),
        (["FILE", "Re"], "last"),
        (["Re", "view"], None),  # data alone: no files
        (["Re", "file"], "contains 'file'"),
        (["Re", "File_name"], "contains 'file'"),
        (["tf_profile", "FILE"], "profile"),
        ([" Re", "FILE"], "padded"),
        (["1.5", "FILE"], "would be read as a number"),
        (["nan", "FILE"], "would be read as a number"),
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
        (["1.0", "NaN", "-2.0"], None),
        (["1", "NaN"], "row 3, column x: 'NaN' is among integers"),
        (["1.0", "inf"], "row 3, column x: inf"),
        (["1", "x"], "row 3, column x: 'x' is among integers"),
        (["x", "1"], "row 3, column x: '1' is among words"),
        (["a", "b", "nan"], None),
        (["", "1", "", "2"], None),
        (["", "1", "", "2.0"], "row 5"),
        (["1", " 2"], "padded"),
        ([], "no row"),
    ],
)
def test_columns_have_one_type(column: list[str], problem: str | None) -> None:
    found = cinema.column_problems(["x", "FILE"], [[cell, "a.png"] for cell in column])
    assert found == [] if problem is None else len(found) == 1 and problem in found[0]


@pytest.mark.parametrize("cell", ["", "/etc/passwd", "../a.png", "a/../../b.png", "a\\b.png", "a\x00.png", " a.png"])
def test_paths_stay_inside(cell: str) -> None:
    assert cinema.column_problems(["x", "FILE"], [["1", cell]])


@pytest.mark.parametrize("cell", ["a.png", "a/b c.png", "./a.png", "..a/b..png", "https://example.org/a.png"])
def test_paths_inside_and_addresses_are_taken(cell: str) -> None:
    assert cinema.column_problems(["x", "FILE"], [["1", cell]]) == []


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ("", "empty"),
        ("\r\n", "empty"),
        ("\ufeffa,FILE\r\n", "byte order mark"),
        ('a,FILE\r\n"x,1\r\n', "row 2, line 2"),
        ('a,FILE\r\n1,"x"y\r\n', "row 2, line 2"),
        ('a,FILE\r\n1,x"y"\r\n', "unexpected quote"),
        ('a,FILE\r\n1, "x"\r\n', "unexpected quote"),
        ("a,FILE\r1,x\r", "newline"),
        ("a,FILE\r\n1\r\n", "row 2 has 1 cells, the header 2"),
        ("a,FILE\r\n1,x\r\n\r\n", "row 3 has 1 cells"),
        ("a,FILE\r\n1,x,", "row 2 has 3 cells"),
    ],
)
def test_what_is_no_table_is_refused(table: str, problem: str) -> None:
    with pytest.raises(cinema.TableError, match=problem):
        cinema.parse(table)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("last", [True, False])
def test_rows_may_end_as_on_any_system(end: str, last: bool) -> None:
    text = end.join(["a,FILE", '1,"x\r\n""y"""', "2,"]) + (end if last else "")
    assert cinema.parse(text) == (["a", "FILE"], [["1", 'x\r\n"y"'], ["2", ""]])


@given(st.text(st.sampled_from('a1 ,"\r\n'), max_size=30))
def test_any_text_is_read_as_rfc_4180_says_or_refused(text: str) -> None:
    """Python's csv module takes more than RFC 4180; where both take a text, they must agree on it."""
    try:
        header, rows = cinema.parse(text)
    except cinema.TableError:
        return
    assert [header, *rows] == [row or [""] for row in csv.reader(io.StringIO(text, newline=""), strict=True)]


@given(st.text(st.sampled_from('a1 ,"\r\n'), max_size=30), st.integers(1, 9))
def test_a_table_in_pieces_is_the_same_table(text: str, size: int) -> None:
    pieces = [text[i : i + size] for i in range(0, len(text), size)]
    try:
        whole = cinema.parse(text)
    except cinema.TableError as error:
        with pytest.raises(cinema.TableError, match=re.escape(str(error).partition(" near")[0])):
            list(cinema.read_rows(pieces))
        return
    assert list(cinema.read_rows(pieces)) == [whole[0], *whole[1]]


def test_a_cell_without_end_takes_no_unbounded_memory() -> None:
    pieces = itertools.chain(['a,FILE\n"'], itertools.repeat("x" * 65536))
    with pytest.raises(cinema.TableError, match="row 2, line 2"), memory_at_most(16 << 20):
        list(cinema.read_rows(pieces))


@pytest.mark.parametrize("value", [True, np.True_, float("nan"), float("inf"), np.float32("nan")])
def test_what_is_no_value_has_no_cell(value: object) -> None:
    with pytest.raises(cinema.TableError):
        cinema.format_cell(value)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "cell"),
    [
        (1.0, "1.0"),
        (0.1, "0.1"),
        (1e22, "1.0e+22"),
        (5e-324, "5.0e-324"),
        (-0.0, "-0.0"),
        (np.float64(2), "2.0"),
        (3, "3"),
    ],
)
def test_floats_always_have_a_point(value: cinema.Cell, cell: str) -> None:
    assert cinema.format_cell(value) == cell


def test_a_large_table_is_read_in_a_moment() -> None:
    text = cinema.format_rows([["a", "b", "FILE"], *([float(i), "word", f"{i}.png"] for i in range(20_000))])
    started = time.process_time()
    assert len(cinema.parse(text)[1]) == 20_000
    assert time.process_time() - started < 2.0
