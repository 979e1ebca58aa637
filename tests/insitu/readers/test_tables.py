"""Tables and patterns of files give the named members, and all errors at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from insitu.readers.tables import is_pattern, match_files, matching, read_table

FILES = (
    "run_100/dump_1.npy",
    "run_100/dump_2.npy",
    "run_250.5/dump_10.npy",
    "run_250.5/notes.txt",
    ".hidden/run_1/dump_1.npy",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


TABLE = """\ufeffpath, Re, nu [m^2/s], split, name
run_100/dump_1.npy, 100, 1e-2, train, first
run_100/dump_2.npy, 100, 2e-2, val,

run_250.5/dump_10.npy, 250.5, 3e-2, test, last
"""


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_table_is_read(folder: Path, separator: str) -> None:
    (folder / "t.csv").write_text(TABLE.replace(", ", separator).replace(",\n", f"{separator}\n"))
    table = read_table(folder / "t.csv")
    assert table.names == ("Re", "nu")
    assert table.units == {"nu": "m^2/s"}
    assert [row.path for row in table.rows] == [folder / name for name in FILES[:3]]
    assert [(row.split, row.name) for row in table.rows] == [("train", "first"), ("validation", ""), ("test", "last")]
    assert table.rows[2].parameters == {"Re": 250.5, "nu": 3e-2}


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    "encoding",
    ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252"],
)
def test_a_table_is_read_in_any_encoding(tmp_path: Path, encoding: str, newline: str) -> None:
    (tmp_path / "größe.npy").touch()
    text = newline.join(["path;Re;width [µm];name", "größe.npy;100;0.5;Straße"])
    (tmp_path / "t.csv").write_bytes(text.encode(encoding))
    table = read_table(tmp_path / "t.csv")
    assert [(row.path.name, dict(row.parameters), row.name) for row in table.rows] == [
        ("größe.npy", {"Re": 100.0, "width": 0.5}, "Straße")
    ]
    assert dict(table.units) == {"width": "µm"}


def test_numbers_may_be_as_fortran_prints_them(tmp_path: Path) -> None:
    (tmp_path / "a.npy").touch()
    (tmp_path / "t.csv").write_text("path,small,large,double\na.npy,0.1584-100,1.5+101,2.5D-03\n")
    [row] = read_table(tmp_path / "t.csv").rows
    assert dict(row.parameters) == {"small": 0.1584e-100, "large": 1.5e101, "double": 2.5e-3}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("path;Re\na;0,5\n", "line 2, column 'Re' must be .*, got '0,5'; write it with a point, 0.5"),
        ("path\tRe\na\t-1,5e3\n", "got '-1,5e3'; write it with a point, -1.5e3"),
        ("path,Re\na,0,5\n", "line 2 has 3 cells, the header 2: separate them by semicolons"),
        ("path,Re\na,100-200\n", "got '100-200'; --parameters"),
        ("", "empty"),
        ("path,Re\n", "names no file"),
        ("Re,nu\n1,2\n", r"needs a column 'path', got Re, nu"),
        ("path\nrun_100/dump_1.npy\n", "of parameters"),
        ("path,Re,Re\na,1,2\n", "each another"),
        ("path,Re,\na,1,2\n", "each another"),
        ("path,Re\na,1,2\n", "line 2 has 3 cells, the header 2"),
        ("path,Re\na,fast\n", "line 2, column 'Re' must be a finite number, got 'fast'; --parameters"),
        ("path,Re\na,nan\n", "line 2, column 'Re'"),
        ("path,Re\na,\n", "line 2, column 'Re'"),
        ("path,Re,split\na,1,tset\n", "line 2: split must be"),
        ("path,Re\nrun_100/dump_1.npy,1\nrun_100/dump_2.npy,1\n", "have the same parameters, Re=1: "),
        ("path,Re\nrun_100/dump_1.npy,1\nrun_100/dump_1.npy,2\n", "have the same file"),
        ("path,Re,name\nrun_100/dump_1.npy,1,a\nrun_100/dump_2.npy,2,a\n", "have the same name"),
        ("path,Re\nx.npy,1\nrun_100/dump_1.npy,2\ny.npy,3\n", r"2 files that are absent: \S*x.npy, \S*y.npy"),
    ],
)
def test_a_wrong_table_is_one_error(folder: Path, text: str, message: str) -> None:
    (folder / "t.csv").write_text(text)
    with pytest.raises((ValueError, FileNotFoundError), match=message) as caught:
        read_table(folder / "t.csv")
    assert "t.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_columns_may_be_chosen(folder: Path) -> None:
    (folder / "t.csv").write_text("path,Re,note\nrun_100/dump_1.npy,1,good\nrun_100/dump_2.npy,2,bad\n")
    assert read_table(folder / "t.csv", ["Re"]).names == ("Re",)
    with pytest.raises(ValueError, match=r"no columns Ra"):
        read_table(folder / "t.csv", ["Ra"])


@pytest.mark.parametrize(
    "pattern",
    [
        "run_{Re}/dump_{time}.npy",
        "{}_{Re}/*_{time}.npy",
        r"run_(?P<Re>[\d.]+)/dump_(?P<time>\d+)\.npy",
    ],
)
def test_a_pattern_names_parameters(folder: Path, pattern: str) -> None:
    assert is_pattern(pattern)
    table = match_files(pattern, folder)
    assert table.names == ("Re", "time")
    assert [tuple(row.parameters.values()) for row in table.rows] == [(100.0, 1.0), (100.0, 2.0), (250.5, 10.0)]
    assert [row.path for row in table.rows] == [folder / name for name in FILES[:3]]


def test_a_pattern_may_begin_with_a_folder_and_repeat_a_name(folder: Path) -> None:
    absolute = f"{folder}/run_100/dump_{{time}}.npy"
    assert [row.parameters["time"] for row in match_files(absolute).rows] == [1.0, 2.0]
    assert [row.parameters["n"] for row in matching("run_{n}/dump_{n}.npy", folder)] == []
    (folder / "run_7").mkdir()
    (folder / "run_7" / "dump_7.npy").touch()
    assert [row.parameters["n"] for row in matching("run_{n}/dump_{n}.npy", folder)] == [7.0]


def test_numbers_may_be_written_in_any_way_and_stores_count_as_files(tmp_path: Path) -> None:
    for name in ("1e-3", "-2.5", "+.5", "007"):
        (tmp_path / f"a_{name}.zarr").mkdir()
        (tmp_path / f"a_{name}.zarr" / "a_3.zarr").touch()
    found = matching("a_{v}.zarr", tmp_path)
    assert sorted(row.parameters["v"] for row in found) == [-2.5, 0.001, 0.5, 7.0]


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("run_{Re}/none_{time}.npy", "no file below"),
        ("run_{}/dump.npy", "names no parameter"),
        ("run_{2}/dump.npy", "begin it with a letter"),
        (r"run_(?P<Re>[\d/dump", "not a regular expression"),
        (r"run_(?P<Re>[\d.]+)/(?P<name>\w+)\.txt", "name must be a finite number, got 'notes'"),
    ],
)
def test_a_wrong_pattern_is_one_error(folder: Path, pattern: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        match_files(pattern, folder)
