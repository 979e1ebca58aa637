"""`catalogs check` finds every kind of damage, and says where."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from catalogs.cli import main
from catalogs.files import cinema
from catalogs.files.images import write_image
from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from tests.catalogs.conftest import add_member, rewrite_record


def rewrite(path: Path, old: str, new: str) -> None:
    text = path.read_bytes().decode()
    assert old in text
    path.write_bytes(text.replace(old, new, 1).encode())


def cut(path: Path, count: int = 30) -> None:
    path.write_bytes(path.read_bytes()[:-count])


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))


def save(path: Path, mode: str) -> None:
    Image.new(mode, (16, 12)).save(path)


def repeat_row(path: Path) -> None:
    table = (path / "data.csv").read_bytes()
    (path / "data.csv").write_bytes(table + table.splitlines(keepends=True)[-1])


IMAGE = "members/first/dvr/003.png"

DAMAGE: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "missing image": (lambda c: (c / IMAGE).unlink(), "row 5", "missing"),
    "truncated image": (lambda c: cut(c / IMAGE), "row 5", "damaged"),
    "empty image": (lambda c: (c / IMAGE).write_bytes(b""), "row 5", "003.png"),
    "wrong size": (lambda c: write_image(c / IMAGE, np.zeros((5, 6, 4), np.uint8)), "003.png", "6x5"),
    "no table": (lambda c: (c / "data.csv").unlink(), "data.csv", "missing"),
    "binary table": (lambda c: (c / "data.csv").write_bytes(b"\xff\xfe\x00"), "data.csv", "decode"),
    "short row": (lambda c: rewrite(c / "data.csv", "120.0,1.0,dvr", "120.0,dvr"), "row 2", "cells"),
    "mixed column": (
        lambda c: rewrite(c / "data.csv", "120.0,1.0,dvr", "high,1.0,dvr"),
        "row 3, column Re",
        "one type",
    ),
    "no number": (lambda c: rewrite(c / "data.csv", "120.0,1.0,dvr", "inf,1.0,dvr"), "row 2, column Re", "inf"),
    "label twice": (lambda c: rewrite(c / "data.csv", "Re,Pr", "Re,Re"), "data.csv", "more than once"),
    "empty cell": (lambda c: rewrite(c / "data.csv", IMAGE, ""), "row 5", "empty"),
    "path outside": (lambda c: rewrite(c / "data.csv", IMAGE, "../" + IMAGE), "row 5", "leaves"),
    "member not in the table": (lambda c: drop_rows(c, "second"), "second", "not in the table"),
    "damaged description": (lambda c: (c / "catalog.json").write_text("{"), "catalog.json", "damaged"),
    "damaged member": (lambda c: (c / "members/first/member.json").write_text("{}"), "member first", "damaged"),
    "lost member": (lambda c: (c / "members/first/member.json").unlink(), "members/first", "not a member"),
    "renamed member": (lambda c: (c / "members/first").rename(c / "members/other"), "member other", "describes first"),
    "other parameters": (lambda c: rewrite(c / "members/first/member.json", "120.0", "121.0"), "first", "rows.csv"),
    "same parameters": (
        lambda c: rewrite_record(c / "members/first", parameters={"Re": 180.0, "Pr": 1.0}),
        "second",
        "of member first",
    ),
    "other value": (
        lambda c: rewrite(c / "data.csv", "120.0,1.0,dvr", "121.0,1.0,dvr"),
        "data.csv",
        "row 2 and maybe others",
    ),
    "other columns": (lambda c: rewrite(c / "data.csv", "Re,Pr", "Pr,Re"), "data.csv", "columns"),
    "row twice": (lambda c: repeat_row(c), "data.csv", "more rows of member second"),
    "lost rows": (lambda c: (c / "members/first/rows.csv").unlink(), "first", "rows.csv"),
    "invented member": (lambda c: rewrite(c / "data.csv", ",first,", ",third,"), "member third", "not stored"),
    "no alpha": (lambda c: save(c / IMAGE, "RGB"), "row 5", "16x12 with 3 channels; its camera makes 16x12 with 4"),
    "gray": (lambda c: save(c / IMAGE, "L"), "row 5", "1 channels"),
    "missing end": (lambda c: cut(c / IMAGE, 12), "row 5", "truncated"),
    "one bit": (lambda c: flip(c / IMAGE), "row 5", "damaged"),
    "another format": (lambda c: (c / IMAGE).write_text("hello"), "row 5", "not a PNG"),
    "stray quote": (lambda c: rewrite(c / "data.csv", "120.0,1.0,dvr", '120.0,1.0,d"r'), "data.csv", "line 2"),
    "newer schema": (lambda c: rewrite(c / "catalog.json", '"schema": 5', '"schema": 9'), "catalog.json", "newer"),
    "table is a pipe": (lambda c: pipe(c / "data.csv"), "data.csv", "named pipe"),
    "description is a pipe": (lambda c: pipe(c / "catalog.json"), "catalog.json", "named pipe"),
    "record is a pipe": (lambda c: pipe(c / "members/first/member.json"), "first", "named pipe"),
    "rows are a pipe": (lambda c: pipe(c / "members/first/rows.csv"), "first", "named pipe"),
    "summary is a pipe": (lambda c: pipe(c / "members/first/field.npz"), "first", "named pipe"),
    "image is a pipe": (lambda c: pipe(c / IMAGE), "row 5", "named pipe"),
    "image is a device": (lambda c: device(c / IMAGE), "row 5", "device"),
    "table is a device": (lambda c: device(c / "data.csv"), "data.csv", "device"),
    "table is a folder": (lambda c: ((c / "data.csv").unlink(), (c / "data.csv").mkdir()), "data.csv", "a folder"),
    "damaged summary": (lambda c: cut(c / "members/first/field.npz"), "first", "summary"),
}


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def drop_rows(path: Path, member: str) -> None:
    lines = (path / "data.csv").read_bytes().decode().splitlines(keepends=True)
    (path / "data.csv").write_bytes("".join(line for line in lines if f",{member}," not in line).encode())


@pytest.mark.parametrize("case", DAMAGE)
def test_damage_is_found_and_placed(catalog: Catalog, case: str) -> None:
    damage, place, problem = DAMAGE[case]
    assert check(catalog.path) == []
    damage(catalog.path)
    findings = [str(finding) for finding in check(catalog.path)]
    assert any(place in finding and problem in finding for finding in findings), findings
    result = CliRunner().invoke(main, ["check", str(catalog.path)])
    assert result.exit_code == 1
    assert "Traceback" not in result.output


def test_the_table_can_be_rebuilt(catalog: Catalog) -> None:
    drop_rows(catalog.path, "second")
    result = CliRunner().invoke(main, ["check", "--repair", str(catalog.path)])
    assert result.exit_code == 0, result.output
    assert result.output.endswith(f"{catalog.path}: nothing wrong now\n")


@pytest.mark.parametrize("damage", [lambda rows: rows.unlink(), pipe, lambda rows: rows.write_text("x")])
def test_the_rows_of_members_can_be_rebuilt(catalog: Catalog, damage: Callable[[Path], object]) -> None:
    before = (catalog.path / "data.csv").read_bytes()
    damage(catalog.path / "members/first/rows.csv")
    result = CliRunner().invoke(main, ["check", "--repair", str(catalog.path)])
    assert result.exit_code == 0, result.output
    assert (catalog.path / "data.csv").read_bytes() == before
    assert (catalog.path / "members/first/rows.csv").is_file()


def test_lost_rows_block_no_writer(catalog: Catalog) -> None:
    (catalog.path / "members/first/rows.csv").unlink()
    (catalog.path / "data.csv").unlink()
    add_member(catalog, "third", 150.0)
    assert [f.place for f in check(catalog.path)] == ["member first"]


def test_the_order_of_members_in_the_table_is_free(catalog: Catalog) -> None:
    lines = (catalog.path / "data.csv").read_bytes().splitlines(keepends=True)
    (catalog.path / "data.csv").write_bytes(b"".join([lines[0], *lines[25:], *lines[1:25]]))
    assert check(catalog.path) == []
    (catalog.path / "data.csv").write_bytes(b"".join([lines[0], *lines[2:25], lines[1], *lines[25:]]))
    assert [f.place for f in check(catalog.path)] == ["data.csv"]


def test_the_smallest_damage_is_one_finding(catalog: Catalog) -> None:
    (catalog.path / IMAGE).unlink()
    assert [str(f) for f in check(catalog.path)] == [f"data.csv row 5, column FILE: {IMAGE} is missing"]
    result = CliRunner().invoke(main, ["check", str(catalog.path)])
    assert "1 finding\n" in result.output


@pytest.mark.parametrize("count", [1, 7])
def test_every_lost_image_is_found_once(catalog: Catalog, count: int) -> None:
    images = sorted(catalog.path.rglob("*.png"))[:: 48 // count][:count]
    for image in images:
        image.unlink()
    found = [str(finding) for finding in check(catalog.path)]
    assert len(found) == count
    for image in images:
        assert sum(str(image.relative_to(catalog.path)) in finding for finding in found) == 1


def test_images_of_members_that_the_table_lacks_are_checked_too(catalog: Catalog) -> None:
    drop_rows(catalog.path, "first")
    (catalog.path / IMAGE).unlink()
    assert any(IMAGE in str(finding) for finding in check(catalog.path))


def test_progress_reaches_the_end(catalog: Catalog) -> None:
    seen: list[tuple[int, int]] = []
    check(catalog.path, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(i, 48) for i in range(1, 49)]


def foreign(tmp_path: Path, table: str) -> Path:
    path = tmp_path / "foreign.cdb"
    path.mkdir()
    write_image(path / "a.png", np.zeros((3, 4, 4), np.uint8))
    (path / "a.vti").write_text("<VTKFile/>")
    (path / "empty.csv").touch()
    (path / "data.csv").write_text(table)
    return path


@pytest.mark.parametrize(
    ("table", "findings"),
    [
        ("time,FILE\n1,a.png\n2,b.png\n", ["data.csv row 3, column FILE: b.png is missing"]),
        ("time,FILE_a,FILE\n1,a.vti,a.png\n", []),
        ("x,y\n1,2.5\n", []),
        ("time,FILE\n1,https://example.org/a.png\n", []),
        ("time,FILE\n1,empty.csv\n", ["data.csv row 2, column FILE: empty.csv is empty"]),
        ("time,FILE\n", ["data.csv: the table has no row: specification D wants at least one"]),
    ],
)
def test_other_peoples_databases_are_checked_too(tmp_path: Path, table: str, findings: list[str]) -> None:
    assert [str(finding) for finding in check(foreign(tmp_path, table))] == findings


def test_what_is_no_database_is_told(tmp_path: Path) -> None:
    assert ["not a folder" in str(f) for f in check(tmp_path / "nothing.cdb")] == [True]
    places = [finding.place for finding in check(tmp_path)]
    assert places == [str(tmp_path), "data.csv"]


names = st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), min_size=1, max_size=6)


@given(st.lists(names, min_size=1, max_size=3, unique=True), st.data())
def test_a_table_that_follows_the_rules_has_no_problem_and_a_broken_one_has(
    labels: list[str], data: st.DataObject
) -> None:
    labels = [f"c{i}{label.strip()}" for i, label in enumerate(labels)]
    labels = [label.replace("f", "g").replace("F", "G") for label in labels]
    kinds = [data.draw(st.sampled_from([st.integers(), st.floats(-1e9, 1e9), st.just("word")])) for _ in labels]
    rows = [[*(data.draw(kind) for kind in kinds), "a.png"] for _ in range(data.draw(st.integers(1, 4)))]
    header, cells = cinema.parse(cinema.format_rows([[*labels, "FILE"], *rows]))
    assert cinema.header_problems(header) == cinema.column_problems(header, cells) == []
    row, column = data.draw(st.integers(0, len(cells) - 1)), data.draw(st.integers(0, len(labels)))
    kept = cells[row][column]
    cells[row][column] = " x" if column < len(labels) else ""
    assert cinema.column_problems(header, cells)
    cells[row][column] = kept
    assert cinema.header_problems([*header, "FILE"])
    assert cinema.header_problems([*header, labels[0]])


def test_a_link_out_of_the_database_is_told(catalog: Catalog, tmp_path: Path) -> None:
    image = catalog.path / IMAGE
    image.rename(tmp_path / "outside.png")
    image.symlink_to(tmp_path / "outside.png")
    assert any("link" in str(finding) for finding in check(catalog.path))
