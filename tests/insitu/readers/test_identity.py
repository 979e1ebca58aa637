"""Contents of files: what is another file is noticed, what is a copy is not."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from insitu.readers import identity
from insitu.readers.identity import contents, is_changed


def test_a_copy_is_the_same_and_a_change_is_not(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    before = contents(path)
    os.utime(path, ns=(0, 0))
    assert not is_changed(path, before)
    path.write_bytes(b"12346")
    assert is_changed(path, before)
    path.write_bytes(b"123456")
    assert is_changed(path, before)


def test_of_a_large_file_blocks_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(identity, "BLOCK", 10)
    monkeypatch.setattr(identity, "BLOCKS", 4)
    path = tmp_path / "a"
    path.write_bytes(bytes(100))
    before = contents(path)
    for place, seen in ((0, True), (99, True), (35, True), (20, False)):
        data = bytearray(100)
        data[place] = 1
        path.write_bytes(data)
        assert (contents(path)["sha256"] != before["sha256"]) is seen


def test_of_a_large_folder_blocks_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(identity, "BLOCK", 10)
    monkeypatch.setattr(identity, "BLOCKS", 4)
    for number in range(40):
        (tmp_path / f"{number:02d}").write_bytes(bytes(100))
    before, read = contents(tmp_path), []
    monkeypatch.setattr(identity, "_blocks", lambda path, count: read.append((path.name, count)) or [b""])
    contents(tmp_path)
    assert read == [("00", 1), ("10", 1), ("20", 1), ("30", 1)]
    monkeypatch.undo()
    monkeypatch.setattr(identity, "BLOCKS", 4)
    (tmp_path / "05").write_bytes(bytes(99))
    assert contents(tmp_path)["sha256"] != before["sha256"]


def test_folders_and_the_files_that_an_index_names_count(tmp_path: Path) -> None:
    (tmp_path / "a.zarr" / "x").mkdir(parents=True)
    chunk = tmp_path / "a.zarr" / "x" / "0"
    chunk.write_bytes(b"1")
    (tmp_path / "part.vtu").write_bytes(b"1")
    index = tmp_path / "a.pvtu"
    index.write_text(
        '<VTKFile type="PUnstructuredGrid"><Piece Source="part.vtu"/><Piece Source="../other.vtu"/></VTKFile>'
    )
    before = contents(tmp_path / "a.zarr"), contents(index)
    chunk.write_bytes(b"2")
    (tmp_path / "part.vtu").write_bytes(b"2")
    assert is_changed(tmp_path / "a.zarr", before[0])
    assert is_changed(index, before[1])
