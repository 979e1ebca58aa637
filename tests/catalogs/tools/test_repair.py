"""`catalogs check --repair` sets aside what must be rendered again, loses nothing, and rendering again gives the same catalog."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.cli import main
from catalogs.files import durable
from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.tools.damage import lasting_problems
from catalogs.tools.repair import DAMAGED, repair
from tests.catalogs.conftest import add_member, make_plan, rewrite_record, small_plan
from tests.support.mortal_disk import IN_TURN, MortalDisk, check_consistent, contents, in_child, in_small_process

FOLDER = Path("members/first")
IMAGE = FOLDER / "dvr/003.png"


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-30])


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def rows_without(path: Path, member: str) -> None:
    lines = (path / "data.csv").read_bytes().decode().splitlines(keepends=True)
    (path / "data.csv").write_bytes("".join(line for line in lines if f",{member}," not in line).encode())


LASTING: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing picture": (lambda c: (c / IMAGE).unlink(), "dvr/003.png is missing"),
    "truncated picture": (lambda c: cut(c / IMAGE), "dvr/003.png is damaged"),
    "altered picture": (lambda c: flip(c / IMAGE), "dvr/003.png is damaged"),
    "picture is a pipe": (lambda c: pipe(c / IMAGE), "named pipe"),
    "all pictures of an appearance": (lambda c: shutil.rmtree(c / FOLDER / "iso"), "iso/000.png is missing"),
    "record": (lambda c: (c / FOLDER / "member.json").write_text("{"), "member.json is damaged"),
    "record and rows": (
        lambda c: [(c / FOLDER / name).write_text("{") for name in ("member.json", "rows.csv")],
        "member.json is damaged",
    ),
    "no record": (lambda c: (c / FOLDER / "member.json").unlink(), "member.json is missing"),
    "summary": (lambda c: cut(c / FOLDER / "field.npz"), "not a field summary"),
}
MENDED: dict[str, Callable[[Path], object]] = {
    "no table": lambda c: (c / "data.csv").unlink(),
    "a table that is no text": lambda c: (c / "data.csv").write_bytes(b"\xff\xfe\x00"),
    "files without rows": lambda c: rows_without(c, "second"),
    "rows without files": lambda c: (c / "data.csv").write_bytes(
        (c / "data.csv").read_bytes() + (c / "data.csv").read_bytes().splitlines(True)[-1].replace(b"second", b"third")
    ),
    "no rows of a member": lambda c: (c / FOLDER / "rows.csv").unlink(),
    "no journal": lambda c: (c / ".journal").unlink(),
}


def everything(path: Path) -> dict[str, tuple[int, int, int]]:
    return {str(p.relative_to(path)): (*p.lstat()[:2], p.lstat().st_mtime_ns) for p in path.rglob("*")}


@pytest.mark.parametrize("case", [*LASTING, *MENDED])
def test_without_repair_nothing_is_written(catalog: Catalog, case: str) -> None:
    (LASTING[case][0] if case in LASTING else MENDED[case])(catalog.path)
    before = everything(catalog.path)
    assert check(catalog.path) or case == "no journal"
    CliRunner().invoke(main, ["check", str(catalog.path)])
    assert everything(catalog.path) == before


@pytest.mark.parametrize("case", LASTING)
def test_damaged_members_are_set_aside_and_can_be_rendered_again(catalog: Catalog, case: str) -> None:
    damage, told = LASTING[case]
    whole = contents(catalog.path)
    damage(catalog.path)
    damaged = everything(catalog.path / FOLDER)
    result = CliRunner().invoke(main, ["check", "--repair", str(catalog.path)])
    assert result.exit_code == 0, result.output
    assert told in result.output
    assert f"moved to {catalog.path / DAMAGED / 'first'}" in result.output
    assert "To make first again" in result.output
    assert everything(catalog.path / DAMAGED / "first") == damaged, "every file is kept as it was"
    assert [m.name for m in catalog.members] == ["second"]
    assert catalog.find({"Re": 120.0, "Pr": 1.0}) is None
    assert check(catalog.path) == []
    (missing,) = catalog.missing
    assert missing.name == "first"
    assert missing.parameters == {"Re": 120.0, "Pr": 1.0}
    assert "Re=120 Pr=1:" in result.output
    add_member(catalog, "first", 120.0, seed=1)
    catalog.rebuild_table()
    assert catalog.missing == ()
    shutil.rmtree(catalog.path / DAMAGED)
    shutil.rmtree(catalog.path / ".missing")
    assert contents(catalog.path) == whole


@pytest.mark.parametrize("case", MENDED)
def test_what_follows_from_the_records_is_made_anew(catalog: Catalog, case: str) -> None:
    whole = contents(catalog.path)
    MENDED[case](catalog.path)
    repaired = repair(catalog.path)
    assert (repaired.set_aside, repaired.findings) == ((), ())
    assert contents(catalog.path) == whole


def test_damaged_again_goes_beside_the_first_one(catalog: Catalog) -> None:
    for _ in range(3):
        (catalog.path / IMAGE).unlink()
        repair(catalog.path)
        add_member(catalog, "first", 120.0, seed=1)
    assert sorted(p.name for p in (catalog.path / DAMAGED).iterdir()) == ["first", "first.2", "first.3"]
    assert check(catalog.path) == []


def test_what_is_no_member_is_set_aside(catalog: Catalog) -> None:
    (catalog.path / "members/note.txt").write_text("kept")
    (catalog.path / "members/empty").mkdir()
    repaired = repair(catalog.path)
    assert [member.name for member in repaired.set_aside] == ["empty", "note.txt"]
    assert repaired.findings == ()
    assert (catalog.path / DAMAGED / "note.txt").read_text() == "kept"


def test_what_nobody_can_decide_is_left_and_told(catalog: Catalog) -> None:
    rewrite_record(catalog.path / "members/second", parameters={"Re": 120.0, "Pr": 1.0})
    result = CliRunner().invoke(main, ["check", "--repair", str(catalog.path)])
    assert result.exit_code == 1
    assert "member second: has the parameters of member first: take the folder of one of them out" in result.output
    assert [m.name for m in catalog.members] == ["first", "second"]


def test_a_member_that_was_replaced_meanwhile_stays(catalog: Catalog) -> None:
    (catalog.path / IMAGE).unlink()

    def replace(done: int, total: int) -> None:
        if done == total:
            writer = catalog.begin_member("first", {"Re": 120.0, "Pr": 1.0}, replace=True)
            with writer:
                for appearance, view in writer.missing():
                    writer.write_image(appearance, view, catalog.image("second", appearance, view))

    assert repair(catalog.path, progress=replace).set_aside == ()
    assert [m.name for m in catalog.members] == ["first", "second"]
    assert check(catalog.path) == []


def test_members_being_written_are_left_alone(catalog: Catalog) -> None:
    writer = catalog.begin_member("slow", {"Re": 150.0, "Pr": 1.0})
    (catalog.path / IMAGE).unlink()
    repair(catalog.path)
    assert catalog.unfinished() == [writer.path]
    with writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, catalog.image("second", appearance, view))
    assert [m.name for m in catalog.members] == ["second", "slow"]
    assert check(catalog.path) == []


def test_a_damaged_description_stops_it_before_anything_is_written(catalog: Catalog) -> None:
    (catalog.path / "catalog.json").write_text("{")
    (catalog.path / IMAGE).unlink()
    before = everything(catalog.path)
    result = CliRunner().invoke(main, ["check", "--repair", str(catalog.path)])
    assert (result.exit_code, "catalog.json is damaged" in result.output) == (1, True)
    assert everything(catalog.path) == before


@pytest.mark.parametrize(
    ("provenance", "told"),
    [({"scene": "tgv"}, "scene 'tgv'"), ({"source": {"kind": "files"}}, "insitu ensemble"), ({}, 'existing="skip"')],
)
def test_it_says_how_members_are_made_again(tmp_path: Path, provenance: dict[str, object], told: str) -> None:
    catalog = Catalog.create(tmp_path / "a.cdb", make_plan(provenance=provenance))
    add_member(catalog, "first", 120.0)
    (catalog.path / IMAGE).unlink()
    assert told in CliRunner().invoke(main, ["check", "--repair", str(catalog.path)]).output


def damaged_catalog(path: Path) -> None:
    catalog = Catalog.create(path, small_plan())
    for number, name in enumerate(("a", "b", "c", "d")):
        add_member(catalog, name, 110.0 + number, seed=number)
    for name in ("a", "c"):
        (path / "members" / name / "dvr/001.png").unlink()
    (path / "members/b/rows.csv").unlink()


def repaired_contents(path: Path) -> dict[str, bytes]:
    """But for the reports, which hold the time."""
    return {name: data for name, data in contents(path).items() if not name.startswith(".missing/")}


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["everything", IN_TURN])
@in_small_process
def test_dead_at_every_operation_the_same_command_completes_it(folder: Path, loss: str) -> None:
    damaged_catalog(folder / "count.cdb")
    disk = MortalDisk(-1, "after", folder)
    disk.install()
    repair(folder / "count.cdb")
    disk.remove()
    total, undisturbed = disk.count, repaired_contents(folder / "count.cdb")
    assert total > 10
    for step in range(1, total + 1):
        path = folder / f"{step}.cdb"
        damaged_catalog(path)

        def work(path: Path = path, step: int = step) -> None:
            MortalDisk(step, loss, path).install()
            repair(path)

        assert os.WTERMSIG(in_child(work)[1]()) == signal.SIGKILL, f"{step} of {total}"
        catalog = Catalog.open(path)
        for row in (path / "data.csv").read_text().splitlines()[1:]:
            named = path / row.rpartition(",")[2]
            assert named.is_file() or named.parts[-3] in ("a", "c")
        assert {"b", "d"} <= {m.name for m in catalog.members}
        assert all(not list(lasting_problems(catalog, path / "members" / name)) for name in ("b", "d"))
        repair(path)
        assert repaired_contents(path) == undisturbed, f"{loss} operation {step} of {total}"
        check_consistent(path)
        shutil.rmtree(path)


def test_a_disk_that_refuses_leaves_the_member_where_it_was(catalog: Catalog, monkeypatch: pytest.MonkeyPatch) -> None:
    (catalog.path / IMAGE).unlink()
    rename = durable.rename

    def refuse(source: Path, target: Path) -> None:
        if DAMAGED in target.parts:
            raise PermissionError(13, "Permission denied", str(target))
        rename(source, target)

    monkeypatch.setattr(durable, "rename", refuse)
    result = CliRunner().invoke(main, ["check", "--repair", str(catalog.path)])
    assert (result.exit_code, "Permission denied" in result.output) == (1, True)
    monkeypatch.undo()
    assert (catalog.path / FOLDER).is_dir()
    assert repair(catalog.path).findings == ()
