"""A commit costs the same for any number of members, and the table is whole for whoever opens it, at any moment."""

from __future__ import annotations

import os
import shutil
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from catalogs.files import cinema, durable
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.table import JOURNAL, SPARE, CatalogTable
from catalogs.tools.check import check
from tests.catalogs.conftest import add_member, make_plan, picture
from tests.support.damage import memory_at_most
from tests.support.mortal_disk import in_child

TICK = 0.01  # seconds: of the clock of stamps, within which file systems in memory show no change


def named(path: Path) -> list[str]:
    """The members in the table, in its order."""
    header, rows = cinema.parse((path / "data.csv").read_bytes().decode())
    return list(dict.fromkeys(row[header.index("member")] for row in rows))


def few_views() -> dict[str, object]:
    whole = make_plan()
    return {"cameras": whole.cameras[:1], "view_splits": whole.view_splits[:1]}


@pytest.fixture
def small(tmp_path: Path) -> Catalog:
    """A catalog of one view and no member."""
    return Catalog.create(tmp_path / "small.cdb", make_plan(**few_views()))


def test_rows_come_in_the_order_of_commits_and_rebuilding_sorts_them(small: Catalog) -> None:
    for name, reynolds in (("c", 110.0), ("a", 120.0), ("b", 130.0)):
        add_member(small, name, reynolds)
        assert check(small.path) == []
    assert named(small.path) == ["c", "a", "b"]
    small.rebuild_table()
    assert named(small.path) == ["a", "b", "c"]
    assert (small.path / "data.csv").read_bytes() == small.table()
    add_member(small, "A", 140.0)
    assert named(small.path) == ["a", "b", "c", "A"]


def test_a_commit_reads_no_other_member(small: Catalog) -> None:
    """Counted in files, so that no clock decides: with 5 members and with 25 a commit opens as many."""
    opened: list[str] = []

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        if watching and event in ("open", "os.listdir", "os.scandir", "glob.glob"):
            opened.append(str(arguments[0]))

    watching = False
    sys.addaudithook(watch)
    counts = {}
    for number in range(25):
        watching, before = True, len(opened)
        add_member(small, f"m{number}", 100.0 + number)
        watching = False
        counts[number] = len(opened) - before
        assert not [path for path in opened if f"members/m{number - 1}/" in path]
    assert counts[5] == counts[24]


def test_a_reader_keeps_the_table_that_it_opened(small: Catalog) -> None:
    add_member(small, "a", 110.0)
    readers = []
    for number in range(6):
        readers.append(((small.path / "data.csv").open("rb"), (small.path / "data.csv").read_bytes()))
        add_member(small, f"b{number}", 120.0 + number)
    for stream, whole in readers:
        with stream:
            assert stream.read() == whole


def test_a_table_nobody_reads_is_grown_and_not_copied(small: Catalog, monkeypatch: pytest.MonkeyPatch) -> None:
    if durable.opened_elsewhere(small.path / "data.csv"):
        pytest.skip("no file leases here")
    for number in range(3):
        add_member(small, f"a{number}", 110.0 + number)
    monkeypatch.setattr(durable, "copy", lambda *_: pytest.fail("copied"))
    nodes = {(small.path / name).stat().st_ino for name in ("data.csv", SPARE)}
    for number in range(5):
        add_member(small, f"b{number}", 120.0 + number)
        assert {(small.path / name).stat().st_ino for name in ("data.csv", SPARE)} == nodes
    assert check(small.path) == []


def without(name: str) -> Callable[[pytest.MonkeyPatch], None]:
    def refuse(*_: object) -> None:
        raise OSError("not here")

    return lambda patch: patch.setattr(os, name, refuse)


POOR_FILE_SYSTEMS: dict[str, Callable[[pytest.MonkeyPatch], None]] = {
    "no hard links": without("link"),
    "no leases": lambda patch: patch.setattr(durable, "opened_elsewhere", lambda _: True),
    "no copying within the kernel": without("copy_file_range"),
}


@pytest.mark.parametrize("lacking", POOR_FILE_SYSTEMS)
def test_poor_file_systems_do(small: Catalog, monkeypatch: pytest.MonkeyPatch, lacking: str) -> None:
    POOR_FILE_SYSTEMS[lacking](monkeypatch)
    for number in range(5):
        add_member(small, f"a{number}", 110.0 + number)
    assert check(small.path) == []
    assert len(named(small.path)) == 5


def edit(path: Path, old: bytes, new: bytes) -> None:
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))


def copy_member(path: Path, name: str, new: str) -> None:
    folder = Path(shutil.copytree(path / "members" / name, path / "members" / new))
    edit(folder / "member.json", f'"{name}"'.encode(), f'"{new}"'.encode())
    edit(folder / "member.json", b"120.0", b"125.0")
    (folder / "rows.csv").unlink()


MEDDLING: dict[str, Callable[[Path], object]] = {
    "member removed": lambda c: shutil.rmtree(c / "members/b"),
    "member copied in": lambda c: copy_member(c, "b", "d"),
    "table edited": lambda c: edit(c / "data.csv", b",b,", b",z,"),
    "table cut": lambda c: os.truncate(c / "data.csv", 200),
    "table lost": lambda c: (c / "data.csv").unlink(),
    "journal lost": lambda c: (c / JOURNAL).unlink(),
    "journal cut": lambda c: os.truncate(c / JOURNAL, (c / JOURNAL).stat().st_size - 9),
    "journal flipped": lambda c: edit(c / JOURNAL, b" b ", b" x "),
    "journal of zeros": lambda c: (c / JOURNAL).write_bytes(bytes(99)),
    "journal is a pipe": lambda c: ((c / JOURNAL).unlink(), os.mkfifo(c / JOURNAL)),
    "spare lost": lambda c: (c / SPARE).unlink(),
    "spare edited": lambda c: (c / SPARE).write_bytes(b"x"),
    "spare is the table": lambda c: ((c / SPARE).unlink(), os.link(c / "data.csv", c / SPARE)),
    "rows lost": lambda c: ((c / "members/b/rows.csv").unlink(), (c / JOURNAL).unlink()),
    "restored from a copy": lambda c: (
        shutil.copytree(c, c.with_suffix(".copy")),
        shutil.rmtree(c),
        c.with_suffix(".copy").rename(c),
    ),
}


@pytest.mark.parametrize("meddling", MEDDLING)
def test_whatever_is_done_to_it_the_next_commit_mends_the_table(small: Catalog, meddling: str) -> None:
    for name, reynolds in (("c", 110.0), ("b", 120.0), ("a", 130.0)):
        add_member(small, name, reynolds)
    time.sleep(TICK)
    MEDDLING[meddling](small.path)
    add_member(small, "e", 140.0)
    present = sorted(p.name for p in (small.path / "members").iterdir())
    assert sorted(named(small.path)) == present
    assert all((small.path / row[-1]).is_file() for row in cinema.parse((small.path / "data.csv").read_text())[1])
    add_member(small, "f", 150.0)
    assert sorted(named(small.path)) == sorted([*present, "f"])


def test_killed_between_a_member_and_its_rows_is_noticed_within_one_tick_of_the_clock(small: Catalog) -> None:
    """Stamps alone would not tell: the folder of members may have changed within the tick that the journal remembers."""
    add_member(small, "a", 110.0)
    kept, journal = (small.path / "data.csv").read_bytes(), (small.path / JOURNAL).read_bytes()
    stamp = os.stat(small.path / "members")

    def die_in_between() -> None:
        CatalogTable.add.__globals__["durable"].link = lambda *_: os._exit(0)
        add_member(small, "b", 120.0)
        os._exit(1)

    assert in_child(die_in_between)[1]() == 0
    os.utime(small.path / "members", ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert (small.path / "data.csv").read_bytes() == kept
    assert (small.path / JOURNAL).read_bytes() == journal
    assert "b" in small
    small.update_table()
    assert named(small.path) == ["a", "b"]
    assert check(small.path) == []


def test_members_are_found_by_their_parameters(small: Catalog) -> None:
    add_member(small, "a", 110.0)
    other = Catalog.open(small.path)
    assert other.find({"Re": 110.0, "Pr": 1.0}) == "a"
    assert other.find({"Pr": 1.0, "Re": np.float32(110.0)}) == "a"
    assert other.find({"Re": np.nextafter(110.0, 111.0), "Pr": 1.0}) is None
    add_member(small, "b", 120.0)
    assert other.find({"Re": 120.0, "Pr": 1.0}) == "b"
    time.sleep(TICK)
    shutil.rmtree(small.path / "members/b")
    assert other.find({"Re": 120.0, "Pr": 1.0}) is None
    with pytest.raises(ValueError, match="missing"):
        other.find({"Re": 120.0})


def test_a_catalog_that_must_not_be_written_is_searched_all_the_same(
    small: Catalog, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_member(small, "a", 110.0)
    (small.path / JOURNAL).unlink()

    def refuse(path: Path) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(durable, "locked", refuse)
    assert small.find({"Re": 110.0, "Pr": 1.0}) == "a"
    assert small.find({"Re": 111.0, "Pr": 1.0}) is None


def replace_member(
    catalog: Catalog, name: str, reynolds: float, *, seed: int, appearances: list[str] | None = None
) -> None:
    """Write a member over one that may be there."""
    with catalog.begin_member(
        name, {"Re": reynolds, "Pr": 1.0}, appearances=appearances, replace=True, outside="allow"
    ) as writer:
        for appearance in appearances or catalog.appearance_names:
            writer.write_image(appearance, 0, picture(seed))


def no_exchange(*_: object) -> None:
    raise OSError("this file system can't")


@pytest.mark.parametrize("exchange", [True, False])
@pytest.mark.parametrize(
    ("reynolds", "appearances"), [(110.0, None), (115.0, None), (110.0, ["iso"])], ids=["same", "moved", "fewer"]
)
def test_a_member_is_replaced(
    small: Catalog, monkeypatch: pytest.MonkeyPatch, exchange: bool, reynolds: float, appearances: list[str] | None
) -> None:
    if not exchange:
        monkeypatch.setattr(durable, "exchange", no_exchange)
    for name, re in (("a", 110.0), ("b", 120.0)):
        add_member(small, name, re, seed=1)
    replace_member(small, "a", reynolds, seed=7, appearances=appearances)
    assert np.array_equal(small.image("a", "iso", 0), picture(7))
    assert small.find({"Re": reynolds, "Pr": 1.0}) == "a"
    assert check(small.path) == []
    assert small.unfinished() == list((small.path / ".unfinished").iterdir()) == []
    if reynolds != 110.0:
        add_member(small, "c", 110.0)
    replace_member(small, "new", 190.0, seed=8)
    assert check(small.path) == []


def test_a_replacement_that_fails_leaves_the_old_member(small: Catalog) -> None:
    add_member(small, "a", 110.0, seed=1)
    before = {p: p.read_bytes() for p in (small.path / "members").rglob("*") if p.is_file()}
    with pytest.raises(RuntimeError), small.begin_member("a", {"Re": 110.0, "Pr": 1.0}, replace=True):
        raise RuntimeError
    with pytest.raises(CatalogError, match="lacks"), small.begin_member("a", {"Re": 110.0, "Pr": 1.0}, replace=True):
        pass
    assert {p: p.read_bytes() for p in (small.path / "members").rglob("*") if p.is_file()} == before


def test_a_replacement_may_not_take_the_parameters_of_another(small: Catalog) -> None:
    add_member(small, "a", 110.0)
    add_member(small, "b", 120.0)
    with pytest.raises(CatalogError, match="member b with parameters"):
        small.begin_member("a", {"Re": 120.0, "Pr": 1.0}, replace=True)


def test_a_damaged_member_may_be_replaced(small: Catalog) -> None:
    add_member(small, "a", 110.0)
    (small.path / "members/a/member.json").write_text("{")
    (small.path / "members/a/rows.csv").unlink()
    replace_member(small, "a", 110.0, seed=3)
    assert check(small.path) == []


@pytest.mark.parametrize(
    ("exchange", "same"),
    [
        (True, True),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in ((True, False), (False, True), (False, False))),
    ],
)
def test_a_replacement_may_die_at_any_operation(folder: Path, exchange: bool, same: bool) -> None:
    """Before, within or after whichever operation: the table names whole images, and the next writer finds one of the two."""
    for step in range(1, 60):
        small = Catalog.create(folder / f"{step}.cdb", make_plan(**few_views()))
        add_member(small, "a", 110.0, seed=1)

        def replace_and_die(catalog: Catalog = small, step: int = step) -> None:
            if not exchange:
                durable.exchange = no_exchange
            die_at(step)
            replace_member(catalog, "a", 110.0 if same else 115.0, seed=7)
            os._exit(1)

        ended = os.waitstatus_to_exitcode(in_child(replace_and_die)[1]())
        assert ended in (0, 1)
        table = cinema.parse((small.path / "data.csv").read_text())[1]
        if exchange:
            assert "a" in small
            assert all((small.path / row[-1]).is_file() for row in table)
        again = Catalog.open(small.path)
        add_member(again, "b", 120.0)
        assert check(again.path) == []
        shown = again.image("a", "iso", 0)
        assert np.array_equal(shown, picture(7)) or np.array_equal(shown, picture(1100))
        shutil.rmtree(small.path)
        if ended == 1:
            assert np.array_equal(shown, picture(7))
            return
    pytest.fail("the replacement never ended")


def die_at(step: int) -> None:
    """Let this process die before the given operation on the disk."""
    count = [0]

    def counted(operate: Callable[..., object]) -> Callable[..., object]:
        def counting(*arguments: object) -> object:
            count[0] += 1
            if count[0] == step:
                os._exit(0)
            return operate(*arguments)

        return counting

    for name in ("write", "append", "sync", "rename", "link", "exchange"):
        setattr(durable, name, counted(getattr(durable, name)))
    durable.SYNCS_AT_ONCE = 1


def test_threads_may_share_a_catalog(small: Catalog) -> None:
    def add(number: int) -> None:
        for step in range(5):
            add_member(small, f"m{number}-{step}", 100.0 + 10 * number + step)

    threads = [threading.Thread(target=add, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(named(small.path)) == 20
    assert check(small.path) == []


def test_rebuilding_holds_no_table_in_memory(small: Catalog, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four members with 16 MB of rows each: what is held is the rows of one, joined and read back."""
    monkeypatch.setattr("catalogs.store.table.rows_in", lambda folder, plan: folder.name.encode() * (1 << 20))
    names = [f"{number:016d}" for number in range(4)]
    monkeypatch.setattr("catalogs.store.table.member_names", lambda catalog: names)
    table = CatalogTable(small.path, small.plan)
    with memory_at_most(40 << 20):
        durable.replace(small.path / "data.csv", table.pieces())
        assert durable.holds(small.path / "data.csv", table.pieces())
    assert (small.path / "data.csv").stat().st_size > 64 << 20
