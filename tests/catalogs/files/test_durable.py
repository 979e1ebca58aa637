"""The door to the disk: replaced whole or not at all, and only the dead are cleaned up after."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import socket
import time
from functools import partial
from pathlib import Path

import pytest

from catalogs.files import durable
from catalogs.store.description import check_place
from tests.support.mortal_disk import in_child


def test_a_failed_replacement_leaves_the_old_contents_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a"
    durable.replace(path, b"old")

    def fail(_: Path) -> None:
        raise OSError("no")

    monkeypatch.setattr(durable, "sync", fail)
    with pytest.raises(OSError, match="no"):
        durable.replace(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_the_dead_left_is_removed_and_what_the_living_write_is_kept(tmp_path: Path) -> None:
    mine = durable.partial_name(tmp_path / "mine")
    mine.mkdir()
    child = os.fork()
    if child == 0:
        folder = durable.partial_name(tmp_path / "dead")
        folder.mkdir()
        (folder / "x").write_text("x")
        durable.partial_name(tmp_path / "file").write_text("x")
        os._exit(0)
    os.waitpid(child, 0)
    (tmp_path / ".hidden").write_text("not ours")
    assert len(durable.remove_abandoned(tmp_path)) == 2
    assert {p.name for p in tmp_path.iterdir()} == {mine.name, ".hidden"}


def abandoned_by(tmp_path: Path, **changes: str) -> Path:
    """The partial file of a writer whose name differs from this process's in `changes`."""
    parts = durable.partial_name(tmp_path / "x").name.removesuffix(durable.PARTIAL).split("~")
    named = dict(zip(("name", "host", "space", "process", "start", "token"), parts, strict=True)) | changes
    path = tmp_path / f"{'~'.join(named.values())}{durable.PARTIAL}"
    (path / "dvr").mkdir(parents=True)
    return path


def age(path: Path, seconds: float) -> None:
    then = time.time() - seconds
    for entry in (*path.iterdir(), path):
        os.utime(entry, (then, then))


@pytest.mark.parametrize(
    ("changes", "quiet_for", "removed"),
    [
        ({}, 9e9, False),  # alive: it may take its time
        ({"start": "1"}, 0.0, True),  # its number was given to another process
        ({"process": "4194305"}, 0.0, True),  # beyond the largest number that Linux gives
        ({"host": "elsewhere"}, 0.0, False),
        ({"host": "elsewhere"}, 80_000.0, False),
        ({"host": "elsewhere"}, 90_000.0, True),
        ({"space": "00000000"}, 0.0, False),  # another container or boot
        ({"space": "00000000", "process": "4194305"}, 0.0, False),
        ({"space": "00000000"}, 90_000.0, True),
    ],
)
def test_only_the_dead_and_the_long_silent_are_cleaned_up_after(
    tmp_path: Path, changes: dict[str, str], quiet_for: float, removed: bool
) -> None:
    path = abandoned_by(tmp_path, **changes)
    age(path, quiet_for)
    assert durable.remove_abandoned(tmp_path) == ([path] if removed else [])
    assert path.exists() != removed


def test_a_folder_that_still_changes_is_not_silent(tmp_path: Path) -> None:
    path = abandoned_by(tmp_path, host="elsewhere")
    age(path, 90_000.0)
    (path / "dvr" / "000.png").write_bytes(b"x")
    assert durable.remove_abandoned(tmp_path) == []


def test_a_writer_that_was_killed_and_not_yet_buried_is_dead(tmp_path: Path) -> None:
    child = os.fork()
    if child == 0:
        durable.partial_name(tmp_path / "x").mkdir()
        os._exit(0)
    os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)  # a zombie now
    assert len(durable.remove_abandoned(tmp_path)) == 1
    os.waitpid(child, 0)


def test_a_link_that_poses_as_left_over_is_not_followed(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.tex").write_text("years of work")
    path = abandoned_by(tmp_path, process="4194305")
    shutil.rmtree(path)
    path.symlink_to(precious)
    assert durable.remove_abandoned(tmp_path) == [path]
    assert (precious / "thesis.tex").exists()


def test_a_host_may_be_called_anything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "node-1.cluster.example.org")
    assert durable.partials(tmp_path) == []
    path = durable.partial_name(tmp_path / "a.b~c")
    path.touch()
    assert durable.partials(tmp_path) == [path]
    assert durable.remove_abandoned(tmp_path) == []


def test_what_is_staged_appears_after_the_block_or_never(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with durable.staged(path, b"new"):
        assert not path.exists()
        assert [partial.read_bytes() for partial in durable.partials(tmp_path)] == [b"new"]
    assert path.read_bytes() == b"new"
    with pytest.raises(RuntimeError), durable.staged(path, b"newer"):
        raise RuntimeError
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("pieces", [[], [b""], [b"a"], [b"ab", b"", b"c" * 9, b"d"], [b"x" * 100]])
def test_what_comes_in_pieces_is_written_and_compared_as_a_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pieces: list[bytes]
) -> None:
    monkeypatch.setattr(durable, "BLOCK", 4)
    path, whole = tmp_path / "a", b"".join(pieces)
    assert not durable.holds(path, pieces)
    durable.replace(path, iter(pieces))
    assert path.read_bytes() == whole
    assert durable.holds(path, iter(pieces))
    assert not durable.holds(path, [*pieces, b"more"])
    assert not durable.holds(path, [b"other", *pieces])
    durable.replace(path, whole + b"longer")
    assert not durable.holds(path, pieces)


def test_folders_are_made_with_their_parents_and_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[Path] = []
    monkeypatch.setattr(durable, "sync", synced.append)
    durable.make_folder(tmp_path / "a/b/c")
    assert set(synced) == {tmp_path, tmp_path / "a", tmp_path / "a/b"}
    durable.make_folder(tmp_path / "a/b/c")
    assert len(synced) == 3


def test_the_lock_lets_one_in_at_a_time(tmp_path: Path) -> None:
    counter = tmp_path / "counter"
    counter.write_text("0")

    def count() -> None:
        for _ in range(50):
            with durable.locked(tmp_path / "lock"):
                counter.write_text(str(int(counter.read_text()) + 1))

    waits = [in_child(count)[1] for _ in range(4)]
    assert [wait() for wait in waits] == [0] * 4
    assert counter.read_text() == "200"


def test_a_file_system_without_locks_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(OSError, match=r"no file locks.*lock"), durable.locked(tmp_path / "lock"):
        pass


def test_a_committed_folder_appears_whole(tmp_path: Path) -> None:
    partial = durable.partial_name(tmp_path / "member")
    (partial / "deep").mkdir(parents=True)
    (partial / "deep" / "a").write_text("1")
    durable.commit_folder(partial, tmp_path / "member")
    assert (tmp_path / "member/deep/a").read_text() == "1"
    assert not partial.exists()


@pytest.mark.parametrize("path", ["~", "~/x.cdb", "~nobody/x.cdb"])
def test_a_tilde_makes_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str) -> None:
    """In whatever makes folders: catalogs, members' places, models."""
    monkeypatch.chdir(tmp_path)
    message = rf"{path} names a folder called {path.partition('/')[0]}, which a shell alone replaces: write that out"
    for refused in (durable.make_folder, durable.require_writable, partial(check_place, plan=None)):
        with pytest.raises(ValueError, match=message):
            refused(Path(path))
    assert not any(tmp_path.iterdir())
    (tmp_path / path.partition("/")[0]).mkdir()  # somebody wants it so
    durable.make_folder(Path(path))
    assert (tmp_path / path).is_dir()
    durable.make_folder(Path("a~b"))


def test_a_folder_of_files_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    durable.write_folder(tmp_path / "site", {"index.html": b"1", "draw/a.js": b"2"})
    assert (tmp_path / "site/draw/a.js").read_bytes() == b"2"
    monkeypatch.setattr(durable, "sync_tree", lambda folder: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        durable.write_folder(tmp_path / "other", {"index.html": b"1"})
    assert [path.name for path in tmp_path.iterdir()] == ["site"]
