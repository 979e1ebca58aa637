"""`catalogs show` says what is there, of our catalogs and of other people's."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.cli import main
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.missing import report_missing
from catalogs.tools.show import describe
from catalogs.vocabulary.cameras import orbit
from tests.catalogs.conftest import make_plan, picture


def test_all_that_one_asks_of_a_catalog_is_shown(catalog: Catalog) -> None:
    shown = describe(catalog.path)
    for text in (
        "members     2 (1 train, 0 validation, 1 test)",
        "Re in [100, 200]; members from 120 to 180, 2 values",
        "Pr in [0.5, 2] m; all members at 1",
        "dvr: volume rendering over [0, 1], unshaded",
        "iso: isosurface at 0.25",
        "12 shared by all members (5 train, 1 validation, 6 test)",
        "48 of 16x12, 8-bit PNG, with alpha",
        "(-1, -1, -1) to (1, 1, 1)",
        "MB",
    ):
        assert text in shown, shown
    rows = [" ".join(line.split()) for line in shown.splitlines()]
    assert "first train 120 1 12 0 1 1.00 %" in rows
    assert "second test 180 1 12 0 1 1.00 %" in rows
    assert "unfinished" not in shown


def test_an_empty_catalog_is_shown(tmp_path: Path) -> None:
    shown = describe(Catalog.create(tmp_path / "a.cdb", make_plan(background=(1, 1, 1))).path)
    assert "none yet" in shown
    assert "0 of 16x12, 8-bit PNG, opaque on the background (1, 1, 1)" in shown


def test_members_that_are_being_written_are_shown(catalog: Catalog) -> None:
    writer = catalog.begin_member("third", {"Re": 150.0, "Pr": 1.0})
    assert "unfinished  third: being written now" in describe(catalog.path)
    with pytest.raises(RuntimeError), writer:
        raise RuntimeError


def test_members_that_are_missing_are_shown_with_the_parameters_that_are_known(catalog: Catalog) -> None:
    report_missing(catalog.path, "third", {"Re": 150.0, "Pr": 1.0}, "out of memory\nat line 7")
    report_missing(catalog.path, "fourth", None, "")
    lines = [line.strip() for line in describe(catalog.path).splitlines()]
    assert "missing     third: out of memory (at Re=150 Pr=1)" in lines, lines
    assert "missing     fourth: no reason recorded" in lines, lines


def test_cameras_of_the_members_own_are_counted(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "own.cdb", make_plan(cameras=(), view_splits=()))
    for count, (name, reynolds) in enumerate({"a": 110.0, "b": 120.0}.items(), start=2):
        cameras = orbit((0, 0, 0), 2, width=8, height=8, frequency=1)[:count]
        with made.begin_member(
            name, {"Re": reynolds, "Pr": 1.0}, cameras=cameras, view_splits=["train"] * count
        ) as writer:
            for appearance, view in writer.missing():
                writer.write_image(appearance, view, picture(view, 8, 8))
    assert "each member's own, 2 to 3 (5 train, 0 validation, 0 test in all)" in describe(made.path)


def test_the_columns_of_other_peoples_databases_are_shown(tmp_path: Path) -> None:
    path = tmp_path / "foreign.cdb"
    path.mkdir()
    (path / "data.csv").write_text("time,phi,what,nothing,FILE\n1,2.5,b,,x.png\n3,-1.5,a,,y.png\n")
    rows = [" ".join(line.split()) for line in describe(path).splitlines()]
    for row in ("time integers 2 1 3", "phi floats 2 -1.5 2.5", "what words 2 a b", "nothing words 0 - -"):
        assert row in rows
    (path / "data.csv").write_text('"')
    with pytest.raises(CatalogError, match=r"data\.csv"):
        describe(path)


def test_the_command_shows_or_says_why_not(catalog: Catalog, tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["show", str(catalog.path)])
    assert result.exit_code == 0
    assert result.output.strip() == describe(catalog.path)
    (tmp_path / "other").mkdir()
    result = CliRunner().invoke(main, ["show", str(tmp_path / "other")])
    assert result.exit_code == 1
    assert "catalog.json is missing" in result.output
