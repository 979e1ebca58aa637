"""The journal is believed only as far as it is whole, and each reading takes in what is new."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from catalogs.files import durable
from catalogs.files.durable import Stamp
from catalogs.store.journal import Journal, Stamps, key_of


def stamps(number: int) -> Stamps:
    return Stamps(number, Stamp(number, 10 * number, 100 * number))


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    """A journal of the members a and b."""
    made = Journal(tmp_path / "journal")
    made.write([(key_of({"x": 1.0}), "a"), (key_of({"x": 2.0}), "b")], stamps(1))
    return made


def test_keys_are_equal_where_values_are() -> None:
    assert key_of({"x": 0.0, "y": 1.0}) == key_of({"x": -0.0, "y": 1})
    keys = {key_of(p) for p in ({"x": 1.0}, {"x": 1.0 + 2**-52}, {"x": 1.0, "y": 1.0}, {"x": 11.0}, {"x": 1e300})}
    assert len(keys) == 5


def test_what_others_append_is_taken_in(journal: Journal, tmp_path: Path) -> None:
    other = Journal(tmp_path / "journal")
    assert other.read() == journal.read() == stamps(1)
    assert other.table_before is None
    for number in (2, 3):
        journal.append([(key_of({"x": float(number + 1)}), f"m{number}")], stamps(number))
    assert other.read() == stamps(3)
    assert set(other.names.values()) == {"a", "b", "m2", "m3"}
    assert other.table_before == stamps(2).table
    other.append([(key_of({"x": 9.0}), "again")], Stamps(4, stamps(3).table))
    assert other.table_before == stamps(2).table, "the table is the same"
    assert journal.read() == Stamps(4, stamps(3).table)


def test_a_journal_that_was_replaced_is_read_anew(journal: Journal, tmp_path: Path) -> None:
    other = Journal(tmp_path / "journal")
    other.read()
    journal.write([(key_of({"x": 5.0}), "e")], stamps(7))
    assert other.read() == stamps(7)
    assert dict(other.names) == {key_of({"x": 5.0}): "e"}


def test_one_in_the_place_of_another_is_read_anew(journal: Journal, tmp_path: Path) -> None:
    """A file system may give a new file the inode of one that is gone."""
    other, path = Journal(tmp_path / "journal"), tmp_path / "journal"
    other.read()
    scratch = Journal(tmp_path / "scratch")
    scratch.write([(key_of({"x": float(n)}), f"n{n}") for n in range(9)], stamps(7))
    path.write_bytes((tmp_path / "scratch").read_bytes())
    assert other.read() == stamps(7)
    assert len(other.names) == 9


@pytest.mark.parametrize("cut", range(1, 60, 7))
def test_what_is_cut_off_is_not_believed(journal: Journal, tmp_path: Path, cut: int) -> None:
    journal.append([(key_of({"x": 3.0}), "c")], stamps(2))
    path = tmp_path / "journal"
    os.truncate(path, path.stat().st_size - cut)
    assert Journal(path).read() in (None, stamps(1))


@pytest.mark.parametrize("place", range(0, 200, 11))
def test_no_flipped_bit_is_believed(journal: Journal, tmp_path: Path, place: int) -> None:
    path = tmp_path / "journal"
    data = bytearray(path.read_bytes())
    data[place % len(data)] ^= 1
    path.write_bytes(bytes(data))
    assert Journal(path).read() is None


@pytest.mark.parametrize("content", [b"", b"\n", b"x y z\n", b"\xff" * 99, b"00000000 - - a b c d\n"])
def test_what_is_no_journal_is_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "journal").write_bytes(content)
    assert Journal(tmp_path / "journal").read() is None


def test_a_disk_that_refuses_has_no_say(journal: Journal, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(durable, "append", refuse)
    monkeypatch.setattr(durable, "write", refuse)
    journal.append([(key_of({"x": 3.0}), "c")], stamps(2))
    journal.write([], stamps(3))
    assert journal.read() == stamps(1)


@pytest.mark.parametrize("lines", [0, 1, 2, 3])
def test_a_commit_of_several_is_believed_when_its_last_line_is_there(journal: Journal, lines: int) -> None:
    """A writer may die between two lines: then the journal must not claim to know all members."""
    path, before = journal._path, journal._path.read_bytes()
    journal.append([(key_of({"x": float(n)}), f"m{n}") for n in (3, 4, 5)], stamps(2))
    assert journal.read() == stamps(2)
    added = path.read_bytes()[len(before) :].splitlines(keepends=True)
    assert len(added) == 3
    path.write_bytes(before + b"".join(added[:lines]))
    again = Journal(path)
    assert again.read() == (stamps(2) if lines == 3 else stamps(1))
    assert len(again.names) == 2 + lines
