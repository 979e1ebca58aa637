"""The door to the disk: replaced whole or not at all, and only the dead are cleaned up after."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from catalogs import durable


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


def test_a_committed_folder_appears_whole(tmp_path: Path) -> None:
    partial = durable.partial_name(tmp_path / "member")
    (partial / "deep").mkdir(parents=True)
    (partial / "deep" / "a").write_text("1")
    durable.commit_folder(partial, tmp_path / "member")
    assert (tmp_path / "member/deep/a").read_text() == "1"
    assert not partial.exists()
