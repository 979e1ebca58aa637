"""`catalogs check` finds every kind of damage, and says where; `catalogs show` says what is there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.catalog import Catalog
from catalogs.check import check
from catalogs.cli import main
from catalogs.images import write_image


def rewrite(path: Path, old: str, new: str) -> None:
    text = path.read_bytes().decode()
    assert old in text
    path.write_bytes(text.replace(old, new, 1).encode())


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-30])


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
    "damaged member": (lambda c: (c / "members/first/member.json").write_text("{}"), "catalog.json", "damaged"),
    "damaged summary": (lambda c: cut(c / "members/first/field.npz"), "first", "summary"),
}


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
    assert "nothing wrong" in result.output


def test_other_peoples_databases_are_checked_too(tmp_path: Path) -> None:
    path = tmp_path / "foreign.cdb"
    path.mkdir()
    write_image(path / "a.png", np.zeros((3, 4, 4), np.uint8))
    (path / "data.csv").write_text("time,FILE\n1,a.png\n2,b.png\n")
    assert [str(finding) for finding in check(path)] == ["data.csv row 3, column FILE: b.png is missing"]


def test_a_link_out_of_the_database_is_told(catalog: Catalog, tmp_path: Path) -> None:
    image = catalog.path / IMAGE
    image.rename(tmp_path / "outside.png")
    image.symlink_to(tmp_path / "outside.png")
    assert any("link" in str(finding) for finding in check(catalog.path))


def test_show_says_what_is_there(catalog: Catalog) -> None:
    result = CliRunner().invoke(main, ["show", str(catalog.path)])
    assert result.exit_code == 0, result.output
    for word in ("first", "second", "120", "180", "16x12", "train", "test", "1.00 %"):
        assert word in result.output
    assert CliRunner().invoke(main, ["show", str(catalog.path.parent)]).exit_code == 1
